"use strict";
// Decodes frames (see wherry/trace/framing.py and codec.py) into records in order of time.

const POSITION_STEP = 0.005; // m
const ANGLE_STEP = 1e-4; // rad
const MAGIC_LENGTH = "wherry-trace: 1\n".length;
const TYPES = { "<i2": Int16Array, "<i4": Int32Array, "<f4": Float32Array, "|u1": Uint8Array };

class Trace {
  constructor() {
    this.records = {};
    for (const type of ["Began", "Said", "Seen", "Explored", "CellsLaid", "Stepped", "Perceived", "Learnt"])
      this.records[type] = [];
    this.moments = []; // s, times that the step buttons go to
    this.end = 0; // s
    this.begin = null; // s
    this.over = false;
  }

  // Decode concatenated frames of a buffer, from an offset that is a multiple of 4 bytes.
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
    if (record.type === "Seen") record.reach = unionOf(this.records.Seen.at(-1)?.reach, [record.pose[0], record.pose[1], record.pose[0], record.pose[1]]);
    this.records[record.type].push(record);
    if (record.time === undefined) return;
    this.begin ??= record.time;
    this.end = Math.max(this.end, record.time);
    if (["Stepped", "Explored", "Said"].includes(record.type) && record.time > (this.moments.at(-1) ?? -1))
      this.moments.push(record.time);
  }

  // Index of the last record of a type that is not later than a time; -1 if there is none.
  indexAt(type, time) {
    return lastNotAfter(this.records[type], time, (record) => record.time);
  }

  at(type, time) {
    return this.records[type][this.indexAt(type, time)];
  }

  // Time at which the robot starts to act by learnt rules, s; Infinity if it does not.
  get actsFrom() {
    const { Learnt, Stepped } = this.records;
    return Stepped.length ? (Learnt[0]?.time ?? Stepped[0].time) : Infinity;
  }

  // {time, phase} of each start of a phase. Before the robot acts, phases are those of its narration. Then each action
  // is in "learn" (an experiment) or "deliver"; it starts when the action before it ended, since records are of ends.
  phases() {
    const { Said, Stepped } = this.records;
    const key = `${Said.length} ${Stepped.length}`;
    if (this.phaseCache?.key === key) return this.phaseCache.bands;
    const from = this.actsFrom;
    const done = Said.findLast((said) => said.phase === "done");
    const starts = Said.filter((said) => said.time < from);
    Stepped.forEach((step, at) => starts.push({ time: Math.max(from, at ? Stepped[at - 1].time : from), phase: step.learning ? "learn" : "deliver" }));
    if (done && done.time >= from) starts.push(done);
    // Of phases that start at the same time, the last one counts.
    const distinct = starts.filter(({ time }, at) => at === starts.length - 1 || starts[at + 1].time > time);
    const bands = distinct.filter(({ phase }, at) => at === 0 || phase !== distinct[at - 1].phase);
    this.phaseCache = { key, bands };
    return bands;
  }
}

// Bounding box of two boxes, as [west, south, east, north]; either may be missing.
function unionOf(a, b) {
  if (!a || !b) return a ?? b ?? null;
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
}

// Index of the last item whose key is not later than a time; -1 if there is none.
function lastNotAfter(items, time, key = (item) => item) {
  let low = 0;
  let high = items.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (key(items[middle]) <= time + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

// Read the trace file that is embedded in the page as base64: a line, then a zlib stream.
async function readEmbeddedTrace(text, trace) {
  const file = await (await fetch("data:application/octet-stream;base64," + text)).blob();
  const stream = file.slice(MAGIC_LENGTH).stream().pipeThrough(new DecompressionStream("deflate"));
  trace.add(await new Response(stream).arrayBuffer());
  trace.over = true;
}

// Receive a run's frames from the server and reconnect when the connection is lost. Calls `onState` with "live", "over"
// or "lost", and whether there is a report; calls `reset` when another run is served.
function readSocket(trace, reset, onState) {
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
        onState("live");
        return;
      }
      const view = new DataView(data);
      next = view.getUint32(0, true);
      const flags = view.getUint32(4, true);
      trace.over = Boolean(flags & 1);
      trace.add(data, 8);
      onState(trace.over ? "over" : "live", Boolean(flags & 2));
    };
    socket.onclose = () => {
      onState("lost");
      setTimeout(connect, 1500);
    };
  };
  connect();
}
