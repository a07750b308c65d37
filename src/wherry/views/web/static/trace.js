"use strict";
// Decodes frames (see wherry/trace/framing.py and codec.py) into records in order of time.

const POSITION_STEP = 0.005; // m, unit of stored positions
const ANGLE_STEP = 1e-4; // rad, unit of stored angles
const TIME_TOLERANCE = 1e-6; // s
const MAGIC_LENGTH = "wherry-trace: 1\n".length; // bytes
const PREFIX_LENGTH = 12; // bytes before a frame's header
const CHECKSUM_END = 8; // offset of the first byte that a frame's length counts
const RECONNECT_DELAY = 1500; // ms
const RUN_OVER = 1; // flags of a message, as in server.py
const HAS_REPORT = 2;
const ARRAY_TYPES = { "<i2": Int16Array, "<i4": Int32Array, "<f4": Float32Array, "|u1": Uint8Array };

// Record types of wherry/trace/records.py by their tags in frames.
const RECORD_TYPES = {
  Began: "RunStarted",
  Said: "Narration",
  Seen: "RobotSnapshot",
  Explored: "MapUpdate",
  CellsLaid: "CellLayout",
  Stepped: "StepTaken",
  Perceived: "PerceivedState",
  Learnt: "LearntModel",
};
const EVENT_TYPES = ["StepTaken", "MapUpdate", "Narration"]; // records that the step buttons go to

class Trace {
  constructor() {
    this.clear();
  }

  clear() {
    this.records = Object.fromEntries(Object.values(RECORD_TYPES).map((type) => [type, []]));
    this.eventTimes = []; // s
    this.begin = null; // s, time of the first record
    this.end = 0; // s, time of the last record
    this.over = false; // whether the run is over
    this.phaseCache = undefined;
  }

  // Decode the concatenated frames of a buffer, from an offset that is a multiple of 4 bytes.
  add(buffer, offset = 0) {
    const view = new DataView(buffer);
    while (offset + PREFIX_LENGTH <= buffer.byteLength) {
      const length = view.getUint32(offset, true);
      if (offset + CHECKSUM_END + length > buffer.byteLength) break;
      this.addFrame(buffer, offset, view.getUint32(offset + CHECKSUM_END, true));
      offset += CHECKSUM_END + length;
    }
  }

  addFrame(buffer, offset, headerLength) {
    const headerStart = offset + PREFIX_LENGTH;
    const record = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, headerStart, headerLength)));
    let position = headerStart + headerLength;
    for (const [name, type, shape] of record.arrays) {
      const ArrayType = ARRAY_TYPES[type];
      const count = shape.reduce((product, side) => product * side, 1);
      record[name] = new ArrayType(buffer, position, count);
      position += (count * ArrayType.BYTES_PER_ELEMENT + 3) & ~3;
    }
    delete record.arrays;
    this.addRecord(RECORD_TYPES[record.type], record);
  }

  addRecord(type, record) {
    if (type === "RobotSnapshot") {
      const [x, y] = record.pose;
      record.drivenExtent = unionOf(this.records.RobotSnapshot.at(-1)?.drivenExtent, [x, y, x, y]);
    }
    if (type === "PerceivedState")
      record.objects = record.things.map(({ kind, name, values }) => ({ className: kind, name, attributes: values }));
    this.records[type].push(record);
    if (record.time === undefined) return;
    this.begin ??= record.time;
    this.end = Math.max(this.end, record.time);
    if (EVENT_TYPES.includes(type) && record.time > (this.eventTimes.at(-1) ?? -1)) this.eventTimes.push(record.time);
  }

  // Index of the last record of a type that is not later than a time; -1 if there is none.
  indexAt(type, time) {
    return lastNotAfter(this.records[type], time, (record) => record.time);
  }

  at(type, time) {
    return this.records[type][this.indexAt(type, time)];
  }

  // Time from which the robot acts to learn and deliver, s; Infinity if it does not.
  get actsFrom() {
    const { LearntModel: models, StepTaken: steps } = this.records;
    return steps.length ? (models[0]?.time ?? steps[0].time) : Infinity;
  }

  // {time, phase} of each start of a phase. Until the robot acts, phases are those of its narration. From then on each
  // action is in "learn" (an experiment) or "deliver"; it starts when the previous one ended, the time of its record.
  phases() {
    const { Narration: narrations, StepTaken: steps } = this.records;
    const key = `${narrations.length} ${steps.length}`;
    if (this.phaseCache?.key === key) return this.phaseCache.phases;
    const from = this.actsFrom;
    const starts = narrations.filter(({ time }) => time < from);
    steps.forEach((step, index) => {
      const begin = index ? steps[index - 1].time : from;
      starts.push({ time: Math.max(from, begin), phase: step.learning ? "learn" : "deliver" });
    });
    const done = narrations.findLast(({ phase }) => phase === "done");
    if (done && done.time >= from) starts.push(done);
    // Of phases that start at the same time, only the last one is shown.
    const distinct = starts.filter(({ time }, index) => index === starts.length - 1 || starts[index + 1].time > time);
    const phases = distinct.filter(({ phase }, index) => index === 0 || phase !== distinct[index - 1].phase);
    this.phaseCache = { key, phases };
    return phases;
  }
}

// Bounding box of two boxes, as [west, south, east, north]; either may be missing.
function unionOf(a, b) {
  if (!a || !b) return a ?? b ?? null;
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
}

// Index of the last item whose time is not later than a time; -1 if there is none.
function lastNotAfter(items, time, timeOf = (item) => item) {
  let low = 0;
  let high = items.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (timeOf(items[middle]) <= time + TIME_TOLERANCE) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

// Read the trace file that is embedded in the page as Base64: a line, then a zlib stream.
async function readEmbeddedTrace(text, trace) {
  const file = await (await fetch("data:application/octet-stream;base64," + text)).blob();
  const stream = file.slice(MAGIC_LENGTH).stream().pipeThrough(new DecompressionStream("deflate"));
  trace.add(await new Response(stream).arrayBuffer());
  trace.over = true;
}

// Receive a run's frames from the server, and reconnect when the connection is lost. Calls `onState` with "live", "over"
// or "lost", and whether there is a report; calls `reset` when the server sends another run.
function readSocket(trace, reset, onState) {
  let runId = null;
  let nextIndex = 0; // of the first frame that was not received yet
  const connect = () => {
    const query = new URLSearchParams(location.search);
    if (runId !== null) {
      query.set("run", runId);
      query.set("from", nextIndex);
    }
    const socket = new WebSocket(socketUrl(query));
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        const greeting = JSON.parse(data);
        if (runId !== null && (greeting.run !== runId || greeting.from !== nextIndex)) reset();
        runId = greeting.run;
        nextIndex = greeting.from;
        onState("live");
        return;
      }
      const view = new DataView(data);
      nextIndex = view.getUint32(0, true);
      const flags = view.getUint32(4, true);
      trace.over = Boolean(flags & RUN_OVER);
      trace.add(data, 8);
      onState(trace.over ? "over" : "live", Boolean(flags & HAS_REPORT));
    };
    socket.onclose = () => {
      onState("lost");
      setTimeout(connect, RECONNECT_DELAY);
    };
  };
  connect();
}
