"use strict";
// Connects trace, player, scene and panels, and handles pointer and keyboard.

const trace = new Trace();
const player = new Player(trace);
const scene = new Scene(element("canvas"), trace);
const panels = new Panels(trace, (time) => player.seek(time));
const PAN_STEP = 60; // px per key press
const CLICK_TOLERANCE = 4; // px that the pointer may move during a click

// Theme: that of the address, the one chosen before, or that of the system.
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
    // Without storage the choice lasts until the page is closed.
  }
}
element("theme").addEventListener("click", switchTheme);

// Legend: layers, which can be hidden, other symbols, and colours of the timeline.
for (const [layer, [text, colour]] of Object.entries(LAYERS)) {
  const checkbox = make("input");
  checkbox.type = "checkbox";
  checkbox.checked = true;
  checkbox.addEventListener("change", () => (checkbox.checked ? scene.hidden.delete(layer) : scene.hidden.add(layer)));
  const label = make("label", "", checkbox, swatch(`var(${colour})`, layer === "plan" ? "dashed" : ""), make("span", "", text));
  label.id = `layer-${layer}`;
  element("layers").append(label);
}
// Layers of each task; all layers for a delivery.
const LAYERS_OF = { map: ["laser", "trail"], localize: ["laser", "particles", "trail"], learn: ["cells"] };
// Label, colour and shape of the symbols that a task has besides its layers.
function symbolsOf({ task }) {
  if (task === "deliver") return SYMBOLS;
  if (task !== "learn") return [["Robot", "--robot", "fork"], ...SYMBOLS.slice(1)]; // without "fork ahead": the shape of a log's robot is unknown
  const classes = new Set((trace.records.PerceivedState[0]?.objects ?? []).map(({ className }) => className));
  if (trace.records.CellLayout[0]?.warehouse.length) classes.add("Warehouse");
  const objects = [...classes].map((className) => {
    const role = ROLES[className] ?? "load";
    return [className, `--${ROLE_COLOURS[role]}`, role === "destination" ? "plain" : "disc"];
  });
  return [...objects, SYMBOLS.find(([text]) => text === "Wall")];
}
let legendKey = "";
function updateLegend() {
  const run = trace.records.RunStarted[0];
  if (!run) return;
  const phases = [...new Set(trace.phases().map(({ phase }) => phase))];
  const delivered = trace.records.StepTaken.at(-1)?.delivered;
  const key = JSON.stringify([run, phases, Boolean(delivered), trace.records.PerceivedState.length > 0]);
  if (key === legendKey) return;
  legendKey = key;
  const layers = LAYERS_OF[run.task] ?? Object.keys(LAYERS);
  for (const layer of Object.keys(LAYERS)) element(`layer-${layer}`).hidden = !layers.includes(layer);
  element("scale").hidden = run.task === "learn";
  const entry = (text, colour, shape) => make("p", "", swatch(colour, shape), make("span", "", text));
  element("symbols-drawn").replaceChildren(...symbolsOf(run).map(([text, colour, shape]) => entry(text, `var(${colour})`, shape)));
  const bands = phases.map((phase) => entry(phaseName(phase, run), `var(--${phase}-phase)`, "plain"));
  if (delivered) bands.push(entry(run.task === "learn" ? "Episode over" : "Box delivered", "var(--card)", "notch"));
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
    : "The server does not answer: the run was stopped. The part of the run received so far can still be replayed.";
  element("report").hidden = !hasReport;
  element("report").search = location.search;
  element("live").hidden = state === "file" || (state === "over" && !player.following);
}
function resetTrace() {
  trace.clear();
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

// Playback.
const onClick = (name, action) => element(name).addEventListener("click", action);
onClick("play", () => player.toggle());
onClick("back", () => player.step(-1));
onClick("forward", () => player.step(1));
onClick("live", () => player.goLive());
element("speed").addEventListener("change", () => player.setSpeed(Number(element("speed").value)));
element("seek").addEventListener("input", () => player.seek(Number(element("seek").value)));

// View.
function follow() {
  scene.mode = scene.mode === "follow" ? "free" : "follow";
  if (scene.mode === "follow") scene.scale = Math.max(scene.scale, 90);
}
onClick("zoom-in", () => scene.zoom(1.4));
onClick("zoom-out", () => scene.zoom(1 / 1.4));
onClick("fit", () => (scene.mode = "fit"));
onClick("follow", follow);

const canvas = element("canvas");
const pointers = new Map(); // position [x, y] of each pressed pointer, px, by its id
let dragged = 0; // px that the pointer has moved since it was pressed
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
  const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, position]) => position);
  dragged += Math.hypot(now[0] - before[0], now[1] - before[1]);
  if (others.length) {
    const distance = (position) => Math.hypot(position[0] - others[0][0], position[1] - others[0][1]);
    scene.zoom(distance(now) / Math.max(distance(before), 1), (now[0] + others[0][0]) / 2, (now[1] + others[0][1]) / 2);
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
onClick("help-open", () => element("help").showModal());
onClick("help-close", () => element("help").close());
element("help").addEventListener("click", (event) => event.target === element("help") && element("help").close()); // a click on the backdrop closes the dialog
const PANS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, dialog")) return;
  if (event.key === " " && event.target.closest("button, summary, input:not([type=range])")) return; // space activates the focused control
  const logStep = event.target === element("log") && { ArrowUp: -1, ArrowDown: 1 }[event.key];
  const pan = event.target === canvas && PANS[event.key];
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (logStep) panels.stepInLog(logStep);
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
  const [now, total] = [clockText(Math.max(player.time - begin, 0)), clockText(trace.end - begin)];
  if (element("clock").textContent !== `${now} / ${total}`) element("clock").replaceChildren(now, make("small", "", ` / ${total}`));
  const seek = element("seek");
  if (Number(seek.max) !== trace.end) seek.max = trace.end;
  seek.min = begin;
  seek.value = player.time;
  seek.setAttribute("aria-valuetext", now);
}

// The phases on the timeline, and a notch for every delivered box.
let phasesKey = "";
function updatePhases() {
  const { Narration: narrations, StepTaken: steps } = trace.records;
  const begin = trace.begin ?? 0;
  const duration = Math.max(trace.end - begin, 1);
  const key = `${narrations.length} ${steps.length} ${duration.toFixed(0)}`;
  if (key === phasesKey) return;
  phasesKey = key;
  const percent = (time) => (100 * (time - begin)) / duration;
  const phases = trace.phases();
  const nodes = phases.map(({ time, phase }, index) => {
    const band = make("i");
    band.style.left = `${percent(time)}%`;
    band.style.right = `${100 - percent(phases[index + 1]?.time ?? trace.end)}%`;
    band.style.setProperty("--c", `var(--${phase}-phase)`);
    return band;
  });
  steps.slice(1).forEach((step, index) => {
    if (step.delivered <= steps[index].delivered) return;
    const notch = make("b");
    notch.style.left = `${percent(step.time)}%`;
    nodes.push(notch);
  });
  element("phases").replaceChildren(...nodes);
}

const SCALE_LENGTHS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100]; // m
const MAX_SCALE_WIDTH = 130; // px
function updateScale() {
  const length = SCALE_LENGTHS.findLast((length) => length * scene.scale <= MAX_SCALE_WIDTH) ?? SCALE_LENGTHS[0];
  element("scale-bar").style.width = `${length * scene.scale}px`;
  element("scale-text").textContent = `${length} m`;
}

const MAX_FRAME_TIME = 0.25; // s by which playback advances in a frame, as after a hidden tab is shown again
let previousFrame = performance.now();
function frame(now) {
  player.advance(Math.min((now - previousFrame) / 1000, MAX_FRAME_TIME));
  previousFrame = now;
  scene.show(player.time);
  scene.draw();
  panels.update(player.time);
  panels.inspect(scene.selected, scene);
  if (trace.records.RunStarted[0]) panels.updateEstimate(trace.records.RunStarted[0], scene.instant.snapshot, scene.instant.pose);
  updateControls();
  updatePhases();
  updateScale();
  updateLegend();
  requestAnimationFrame(frame);
}
new ResizeObserver(() => scene.resize()).observe(canvas);
scene.resize();
requestAnimationFrame(frame);
