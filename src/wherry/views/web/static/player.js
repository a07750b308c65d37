"use strict";
// Playback of a trace, which may still grow while it is played.

class Player {
  constructor(trace) {
    this.trace = trace;
    this.time = 0; // s
    this.speed = 10; // times real time; 0 follows the run
    this.playing = true;
    this.following = false; // whether the end of a growing trace is shown
  }

  get atEnd() {
    return this.time >= this.trace.end - 1e-6;
  }

  // Advance by a real time, s.
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

  // Pause at the next or previous event.
  step(by) {
    const { moments } = this.trace;
    this.playing = false;
    const here = lastNotAfter(moments, this.time);
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
