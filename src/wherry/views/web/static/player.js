"use strict";
// Plays a trace that may still grow: the run goes as fast as it can, the player as fast as people want.

class Player {
  constructor(trace) {
    this.trace = trace;
    this.time = 0; // s
    this.speed = 10; // times real time; 0 is as fast as the run
    this.playing = true;
    this.following = false; // the end of a trace that still grows
  }

  get atEnd() {
    return this.time >= this.trace.end - 1e-6;
  }

  // Let so many real seconds pass.
  advance(seconds) {
    if (!this.playing || this.trace.begin === null) return;
    this.time = Math.max(this.time, this.trace.begin);
    const further = this.speed === 0 || this.following ? Infinity : this.time + seconds * this.speed;
    this.time = Math.min(further, this.trace.end);
    if (this.atEnd && this.trace.over) this.playing = false;
  }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && this.atEnd && this.trace.over) this.time = this.trace.begin ?? 0;
  }

  seek(time) {
    this.following = false;
    this.time = Math.min(Math.max(time, this.trace.begin ?? 0), this.trace.end);
  }

  // Pause, and go to the next thing that happened, or the one before.
  step(by) {
    const { moments } = this.trace;
    this.playing = false;
    const here = lastBefore(moments, this.time);
    const onIt = here >= 0 && Math.abs(moments[here] - this.time) < 1e-3;
    const next = by > 0 ? here + 1 : onIt ? here - 1 : here;
    this.seek(moments[Math.min(Math.max(next, 0), moments.length - 1)] ?? this.time);
  }

  goLive() {
    this.following = true;
    this.playing = true;
    this.time = this.trace.end;
  }

  setSpeed(speed) {
    this.speed = speed;
    this.following = false;
  }
}
