"use strict";
// Connects trace, player, scene and panels, and handles mouse, touch and keys.

const settings = JSON.parse(element("settings").textContent);
const trace = new Trace();
const player = new Player(trace);
const scene = new Scene(element("canvas"), trace);
const panels = new Panels(trace, (time) => player.seek(time));
const PAN_STEP = 60; // px per key press
const CLICK_TOLERANCE = 4; // px that the pointer may move during a click

// Theme: the one chosen before, or else that of the system.
function setTheme(name) {
  document.documentElement.dataset.theme = name;
  scene.theme();
}
function storedTheme() {
  try {
    return localStorage.getItem("wherry-theme");
  } catch {
    return null; // storage may be blocked
  }
}
setTheme(new URLSearchParams(location.search).get("theme") ?? storedTheme() ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
function switchTheme() {
  const name = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  setTheme(name);
  try {
    localStorage.setItem("wherry-theme", name);
  } catch {
    // without storage, the theme lasts until the page is closed
  }
}
element("theme").addEventListener("click", switchTheme);

// The legend: layers, which can be hidden, other symbols, and colours of the timeline.
function swatch(colour, shape = "") {
  const mark = make("i", shape);
  mark.style.setProperty("--c", colour);
  return mark;
}
for (const [layer, [words, colour]] of Object.entries(LAYERS)) {
  const box = make("input");
  box.type = "checkbox";
  box.checked = true;
  box.addEventListener("change", () => (box.checked ? scene.hidden.delete(layer) : scene.hidden.add(layer)));
  const label = make("label", "", box, swatch(`var(${colour})`, layer === "plan" ? "dashed" : ""), make("span", "", words));
  label.id = `layer-${layer}`;
  element("layers").append(label);
}
// Layers by task; a log has no boxes or cells, and a learner on a grid no laser.
const LAYERS_OF = { map: ["laser", "trail"], localize: ["laser", "particles", "trail"], learn: ["cells"] };
// [text, colour, shape] of the other symbols.
function symbolsOf({ task }) {
  if (task === "deliver") return SYMBOLS;
  if (task !== "learn") return [["Robot", "--robot", "fork"], ...SYMBOLS.slice(1)]; // the shape of a log's robot is unknown
  const kinds = new Set((trace.records.Perceived[0]?.things ?? []).map(({ kind }) => kind));
  if (trace.records.CellsLaid[0]?.warehouse.length) kinds.add("Warehouse");
  const objects = [...kinds].map((kind) => {
    const role = KINDS[kind] ?? "load";
    return [kind, `--${KIND_COLOURS[role]}`, role === "place" ? "plain" : "disc"];
  });
  return [...objects, SYMBOLS.find(([words]) => words === "Wall")];
}
let legendKey = "";
function updateLegend() {
  const began = trace.records.Began[0];
  if (!began) return;
  const phases = [...new Set(trace.phases().map(({ phase }) => phase))];
  const boxes = trace.records.Stepped.at(-1)?.delivered;
  const key = JSON.stringify([began, phases, Boolean(boxes), trace.records.Perceived.length > 0]);
  if (key === legendKey) return;
  legendKey = key;
  const layers = LAYERS_OF[began.task] ?? Object.keys(LAYERS);
  for (const layer of Object.keys(LAYERS)) element(`layer-${layer}`).hidden = !layers.includes(layer);
  element("scale").hidden = began.task === "learn";
  const entry = (words, colour, shape) => make("p", "", swatch(colour, shape), make("span", "", words));
  element("symbols-drawn").replaceChildren(...symbolsOf(began).map(([words, colour, shape]) => entry(words, `var(${colour})`, shape)));
  const bands = phases.map((phase) => entry(phaseName(phase, began), `var(--${phase}-phase)`, "plain"));
  if (boxes) bands.push(entry(began.task === "learn" ? "Episode over" : "Box delivered", "var(--card)", "notch"));
  element("bands").replaceChildren(...bands);
}
if (matchMedia("(max-width: 720px)").matches) element("legend").open = false;

// Connection.
function showConnection(state, hasReport = false) {
  const link = element("link");
  const labels = { live: "live", over: "run over", lost: "no server", file: "recording" };
  link.textContent = labels[state];
  link.dataset.state = state;
  const notice = element("notice");
  notice.hidden = state !== "lost";
  notice.textContent = trace.over
    ? "The run is over and its server has stopped. It can be replayed until you close this page."
    : "The server does not answer: the run was stopped. What was received can still be replayed.";
  element("report").hidden = !hasReport;
  element("report").search = location.search;
  element("live").hidden = state === "file" || (state === "over" && !player.following);
}
function resetTrace() {
  const fresh = new Trace();
  trace.records = fresh.records;
  Object.assign(trace, { moments: [], end: 0, begin: null, over: false });
  trace.phaseCache = undefined;
  scene.map.clear();
  scene.selected = null;
  panels.clear();
  player.time = 0;
}
if (settings.source === "socket") readSocket(trace, resetTrace, showConnection);
else
  readEmbeddedTrace(element("trace").textContent, trace).then(() => {
    element("trace").remove();
    showConnection("file");
  });
// Transport.
const press = (name, action) => element(name).addEventListener("click", action);
press("play", () => player.toggle());
press("back", () => player.step(-1));
press("forward", () => player.step(1));
press("live", () => player.goLive());
element("speed").addEventListener("change", () => player.setSpeed(Number(element("speed").value)));
element("seek").addEventListener("input", () => player.seek(Number(element("seek").value)));

// View.
function follow() {
  scene.mode = scene.mode === "follow" ? "free" : "follow";
  if (scene.mode === "follow") scene.scale = Math.max(scene.scale, 90);
}
press("zoom-in", () => scene.zoom(1.4));
press("zoom-out", () => scene.zoom(1 / 1.4));
press("fit", () => (scene.mode = "fit"));
press("follow", follow);

const canvas = element("canvas");
const pointers = new Map();
let dragged = 0;
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  if (pointers.size === 1) dragged = 0;
});
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) {
    canvas.classList.toggle("over", ["robot", "box", "warehouse", "object"].includes(scene.pick(event.offsetX, event.offsetY)?.kind));
    return;
  }
  const now = [event.offsetX, event.offsetY];
  const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
  dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
  if (others.length) {
    const apart = (place) => Math.hypot(place[0] - others[0][0], place[1] - others[0][1]);
    scene.zoom(apart(now) / Math.max(apart(before), 1), (now[0] + others[0][0]) / 2, (now[1] + others[0][1]) / 2);
  } else if (dragged > CLICK_TOLERANCE) {
    canvas.classList.add("dragging");
    scene.pan(now[0] - before[0], now[1] - before[1]);
  }
  pointers.set(event.pointerId, now);
});
for (const end of ["pointerup", "pointercancel"])
  canvas.addEventListener(end, (event) => {
    pointers.delete(event.pointerId);
    canvas.classList.remove("dragging");
    if (end === "pointerup" && dragged <= CLICK_TOLERANCE) scene.selected = scene.pick(event.offsetX, event.offsetY);
  });
canvas.addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    scene.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  },
  { passive: false },
);

const KEYS = {
  " ": () => player.toggle(),
  "+": () => scene.zoom(1.4),
  "=": () => scene.zoom(1.4),
  "-": () => scene.zoom(1 / 1.4),
  0: () => (scene.mode = "fit"),
  f: follow,
  l: () => player.goLive(),
  t: switchTheme,
  o: () => scene.pickNext(),
  Escape: () => (scene.selected = null),
  "?": () => element("help").showModal(),
};
press("help-open", () => element("help").showModal());
press("help-close", () => element("help").close());
element("help").addEventListener("click", (event) => event.target === element("help") && element("help").close()); // a click on the backdrop
const PANS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, dialog")) return;
  if (event.key === " " && event.target.closest("button, summary, input:not([type=range])")) return; // space activates the focused control
  const line = event.target === element("log") && { ArrowUp: -1, ArrowDown: 1 }[event.key];
  const pan = event.target === canvas && PANS[event.key];
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (line) panels.stepInLog(line);
  else if (pan) scene.pan(pan[0] * PAN_STEP, pan[1] * PAN_STEP);
  else if (step) player.step(step);
  else if (KEYS[event.key]) KEYS[event.key]();
  else return;
  event.preventDefault();
});

// Update the controls and their accessible states.
function updateControls() {
  document.body.toggleAttribute("data-playing", player.playing);
  element("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
  element("fit").setAttribute("aria-pressed", scene.mode === "fit");
  element("follow").setAttribute("aria-pressed", scene.mode === "follow");
  element("live").setAttribute("aria-pressed", player.following || (player.atEnd && player.playing && !trace.over));
  element("waiting").hidden = trace.begin !== null;
  const begin = trace.begin ?? 0; // a real robot's clock does not start at 0
  const [now, all] = [clockText(Math.max(player.time - begin, 0)), clockText(trace.end - begin)];
  if (element("clock").textContent !== `${now} / ${all}`) element("clock").replaceChildren(now, make("small", "", ` / ${all}`));
  const seek = element("seek");
  if (Number(seek.max) !== trace.end) seek.max = trace.end;
  seek.min = begin;
  seek.value = player.time;
  seek.setAttribute("aria-valuetext", now);
}

// The phases on the timeline, and a notch for every delivered box.
let phasesKey = "";
function updatePhases() {
  const { Said, Stepped } = trace.records;
  const begin = trace.begin ?? 0;
  const duration = Math.max(trace.end - begin, 1);
  const key = `${Said.length} ${Stepped.length} ${duration.toFixed(0)}`;
  if (key === phasesKey) return;
  phasesKey = key;
  const place = (time) => `${(100 * (time - begin)) / duration}%`;
  const bands = trace.phases();
  const nodes = bands.map(({ time, phase }, at) => {
    const band = make("i");
    band.style.left = place(time);
    band.style.right = `${100 - (100 * ((bands[at + 1]?.time ?? trace.end) - begin)) / duration}%`;
    band.style.setProperty("--c", `var(--${phase}-phase)`);
    return band;
  });
  for (let at = 1; at < Stepped.length; at++)
    if (Stepped[at].delivered > Stepped[at - 1].delivered) {
      const notch = make("b");
      notch.style.left = place(Stepped[at].time);
      nodes.push(notch);
    }
  element("phases").replaceChildren(...nodes);
}

const SCALES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100]; // m
function updateScale() {
  const length = SCALES.findLast((metres) => metres * scene.scale <= 130) ?? SCALES[0];
  element("scale-bar").style.width = `${length * scene.scale}px`;
  element("scale-text").textContent = `${length} m`;
}

let before = performance.now();
function frame(now) {
  player.advance(Math.min((now - before) / 1000, 0.25));
  before = now;
  scene.show(player.time);
  scene.draw();
  panels.update(player.time);
  panels.inspect(scene.selected, scene);
  if (trace.records.Began[0]) panels.updateEstimate(trace.records.Began[0], scene.instant.seen, scene.instant.pose);
  updateControls();
  updatePhases();
  updateScale();
  updateLegend();
  requestAnimationFrame(frame);
}
new ResizeObserver(() => scene.resize()).observe(canvas);
scene.resize();
requestAnimationFrame(frame);
