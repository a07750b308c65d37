"use strict";
// A trace as it comes: frames (see views/frames.py) in, records in the order of time out.

const POSITION_STEP = 0.005; // m
const ANGLE_STEP = 1e-4; // rad
const MAGIC_LENGTH = "wherry-trace: 1\n".length;
const TYPES = { "<i2": Int16Array, "<i4": Int32Array, "<f4": Float32Array, "|u1": Uint8Array };

class Trace {
  constructor() {
    this.records = {};
    for (const type of ["Began", "Said", "Seen", "Explored", "CellsLaid", "Stepped", "Perceived", "Learnt"])
      this.records[type] = [];
    this.moments = []; // s: when something happened that is worth stepping to
    this.end = 0; // s
    this.begin = null; // s
    this.over = false;
  }

  // Take in whole frames in a row, from a byte of a buffer on that is a multiple of four.
  add(buffer, from = 0) {
    const view = new DataView(buffer);
    let at = from;
    while (at + 12 <= buffer.byteLength) {
      const length = view.getUint32(at, true);
      if (at + 8 + length > buffer.byteLength) break;
      this.addFrame(buffer, at, view.getUint32(at + 8, true));
      at += 8 + length;
    }
  }

  addFrame(buffer, at, headerLength) {
    const record = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, at + 12, headerLength)));
    let place = at + 12 + headerLength;
    for (const [name, type, shape] of record.arrays) {
      const Type = TYPES[type];
      const count = shape.reduce((product, side) => product * side, 1);
      record[name] = new Type(buffer, place, count);
      place += (count * Type.BYTES_PER_ELEMENT + 3) & ~3;
    }
    delete record.arrays;
    if (record.type === "Seen") record.reach = joinedBoxes(this.records.Seen.at(-1)?.reach, [record.pose[0], record.pose[1], record.pose[0], record.pose[1]]);
    this.records[record.type].push(record);
    if (record.time === undefined) return;
    this.begin ??= record.time;
    this.end = Math.max(this.end, record.time);
    if (["Stepped", "Explored", "Said"].includes(record.type) && record.time > (this.moments.at(-1) ?? -1))
      this.moments.push(record.time);
  }

  // Index of the last record of a type at a time or before; -1 if there is none.
  indexAt(type, time) {
    return lastBefore(this.records[type], time, (record) => record.time);
  }

  at(type, time) {
    return this.records[type][this.indexAt(type, time)];
  }

  // When it begins to act by rules, or Infinity.
  get actsFrom() {
    const { Learnt, Stepped } = this.records;
    return Stepped.length ? (Learnt[0]?.time ?? Stepped[0].time) : Infinity;
  }

  // {time, phase} wherever another phase begins. While it acts, each action says which one it belongs to, an experiment
  // or a plan; a step is told when it ends, so that it begins where the one before ended. Else it is what was said.
  phases() {
    const { Said, Stepped } = this.records;
    const key = `${Said.length} ${Stepped.length}`;
    if (this.phasesOf?.key === key) return this.phasesOf.bands;
    const from = this.actsFrom;
    const done = Said.findLast((said) => said.phase === "done");
    const starts = Said.filter((said) => said.time < from);
    Stepped.forEach((step, at) => starts.push({ time: Math.max(from, at ? Stepped[at - 1].time : from), phase: step.learning ? "learn" : "deliver" }));
    if (done && done.time >= from) starts.push(done);
    // Of those that begin at once, the last one counts.
    const real = starts.filter(({ time }, at) => at === starts.length - 1 || starts[at + 1].time > time);
    const bands = real.filter(({ phase }, at) => at === 0 || phase !== real[at - 1].phase);
    this.phasesOf = { key, bands };
    return bands;
  }
}

// The box around two boxes, each as west, south, east, north, of which one may be missing.
function joinedBoxes(a, b) {
  if (!a || !b) return a ?? b ?? null;
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
}

// Index of the last item whose key is not after a time; -1 if there is none.
function lastBefore(items, time, key = (item) => item) {
  let low = 0;
  let high = items.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (key(items[middle]) <= time + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

// The trace that the page carries with it: base64 of a file, that is a line and a zlib stream.
async function readCarriedTrace(text, trace) {
  const file = await (await fetch("data:application/octet-stream;base64," + text)).blob();
  const stream = file.slice(MAGIC_LENGTH).stream().pipeThrough(new DecompressionStream("deflate"));
  trace.add(await new Response(stream).arrayBuffer());
  trace.over = true;
}

// Take a run's frames from the server; tell `say` how the connection is, "live", "over" or
// "lost", and whether there is a report.
function readSocket(trace, reset, say) {
  let run = null;
  let next = 0;
  const connect = () => {
    const query = new URLSearchParams(location.search);
    if (run !== null) {
      query.set("run", run);
      query.set("from", next);
    }
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket?${query}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        const hello = JSON.parse(data);
        if (run !== null && (hello.run !== run || hello.from !== next)) reset();
        run = hello.run;
        next = hello.from;
        say("live");
        return;
      }
      const view = new DataView(data);
      next = view.getUint32(0, true);
      const bits = view.getUint32(4, true);
      trace.over = Boolean(bits & 1);
      trace.add(data, 8);
      say(trace.over ? "over" : "live", Boolean(bits & 2));
    };
    socket.onclose = () => {
      say("lost");
      setTimeout(connect, 1500);
    };
  };
  connect();
}
