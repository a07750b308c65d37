"use strict";
// Playback of a trace, which may be recorded or still growing.

class Player {
  constructor(trace) {
    this.trace = trace;
    this.time = 0; // s
    this.speed = 10; // s of the robot's clock per s; 0 shows the latest time
    this.playing = true;
    this.following = false; // whether the latest time of a live run is shown
  }

  get atEnd() {
    return this.time >= this.trace.end - TIME_TOLERANCE;
  }

  // Advance by a time on the wall clock, s.
  advance(seconds) {
    if (!this.playing || this.trace.begin === null) return;
    this.time = Math.max(this.time, this.trace.begin);
    const target = this.speed === 0 || this.following ? Infinity : this.time + seconds * this.speed;
    this.time = Math.min(target, this.trace.end);
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

  // Pause at the next (direction 1) or previous (-1) event.
  step(direction) {
    const { eventTimes } = this.trace;
    this.playing = false;
    const current = lastNotAfter(eventTimes, this.time);
    const isAtEvent = current >= 0 && Math.abs(eventTimes[current] - this.time) < 1e-3;
    const next = direction > 0 ? current + 1 : isAtEvent ? current - 1 : current;
    this.seek(eventTimes[Math.min(Math.max(next, 0), eventTimes.length - 1)] ?? this.time);
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
