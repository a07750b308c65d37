"use strict";
// Edits a world file. The text is the only model: drawing changes its characters, and the server checks it.

const element = (name) => document.getElementById(name);
const settings = JSON.parse(element("settings").textContent);
const COLUMNS = 4; // characters from one cell's wall to the next one's
const ROWS = 2; // lines from one cell's wall to the next one's
const CHECK_DELAY = 120; // ms after the last change
const MAX_HISTORY = 300; // steps that can be undone
const MIN_CELL_SIZE = 14; // px, side of a cell; larger plans scroll
const WALL_REACH = 0.26; // distance from an edge within which its wall is drawn, in sides of a cell

const TOOLS = [
  ["wall", "Wall", "--wall", "Click the edge of a cell, or drag along several; on a wall, this removes it."],
  ["obstacle", "Obstacle", "--soft", "Click a cell, or drag over several; on an obstacle, this removes it."],
  ["w", "Warehouse", "--warehouse", "Click the cells to which boxes are delivered."],
  ["o", "Box", "--box", "Click the cells where boxes stand; without any, boxes are placed at random."],
  ["robot", "Robot", "--accent", "Click the cell where the robot starts; a second click turns it."],
  ["erase", "Erase", "--particle", "Click a wall or a cell to clear it."],
];
const ARROWS = ">^<v";

let text = settings.text;
let savedHere = false; // whether this page has saved the file
let saved = settings.new ? null : settings.text;
let past = [];
let future = [];
let tool = "wall";
let cursor = null; // cell [x, y] of the keyboard cursor
let found = { error: null, unreachable: [] };

// The fields and the drawing as rows of characters; null if the drawing is no rectangle of cells.
function parts(of = text) {
  const lines = of.replace(/\s+$/, "").split("\n").map((line) => line.trimEnd());
  const first = lines.findIndex((line) => line.startsWith("+"));
  if (first < 0) return null;
  const drawing = lines.slice(first);
  const wide = drawing[0].length;
  if (wide % COLUMNS !== 1 || wide < 5 || drawing.length % ROWS !== 1 || drawing.length < 3) return null;
  if (drawing.some((line) => line.length !== wide)) return null;
  return { fields: lines.slice(0, first), rows: drawing.map((line) => [...line]), width: (wide - 1) / COLUMNS, height: (drawing.length - 1) / ROWS };
}

const joined = ({ fields, rows }) => [...fields, ...rows.map((row) => row.join(""))].join("\n") + "\n";
const rowOf = (plan, y) => (plan.height - 1 - y) * ROWS + 1;
const columnOf = (x) => x * COLUMNS + 1;
const cellText = (plan, x, y) => plan.rows[rowOf(plan, y)].slice(columnOf(x), columnOf(x) + COLUMNS - 1).join("");

function setCell(plan, x, y, symbols) {
  [...symbols.padStart(Math.ceil((3 + symbols.length) / 2)).padEnd(3)].forEach((sign, at) => (plan.rows[rowOf(plan, y)][columnOf(x) + at] = sign));
}

// Row, column and characters of the wall on a side of a cell; null on the outer edge.
function wallPlace(plan, x, y, dx, dy) {
  if (x + dx < 0 || x + dx >= plan.width || y + dy < 0 || y + dy >= plan.height) return null;
  const row = rowOf(plan, y) - dy;
  return dx ? [row, columnOf(x) + (dx > 0 ? COLUMNS - 1 : -1), "|"] : [row, columnOf(x), "---"];
}

function hasWall(plan, [row, column, wall]) {
  return plan.rows[row].slice(column, column + wall.length).join("") === wall;
}

function setWall(plan, [row, column, wall], stands) {
  [...wall].forEach((sign, at) => (plan.rows[row][column + at] = stands ? sign : " "));
}

// Apply the tool to a cell; `paint` is whether the stroke adds or removes.
function drawIn(plan, x, y, paint) {
  const symbols = cellText(plan, x, y).replaceAll(" ", "");
  const without = (sign) => [...symbols].filter((other) => other !== sign).join("");
  const letters = symbols.replace(/[^A-Z]/g, "");
  if (tool === "erase") return setCell(plan, x, y, "");
  if (tool === "obstacle") return setCell(plan, x, y, paint ? "###" : "");
  if (tool === "robot") {
    for (let row = 0; row < plan.height; row++)
      for (let column = 0; column < plan.width; column++) {
        const there = cellText(plan, column, row);
        if ((column !== x || row !== y) && [...there].some((sign) => ARROWS.includes(sign)))
          setCell(plan, column, row, there.replace(/[>^<v ]/g, ""));
      }
    const arrow = [...symbols].find((sign) => ARROWS.includes(sign));
    const next = arrow ? ARROWS[(ARROWS.indexOf(arrow) + 1) % 4] : ">";
    return setCell(plan, x, y, next + (symbols.includes("w") ? "w" : "") + letters);
  }
  const rest = without(tool).replace("###", "");
  return setCell(plan, x, y, paint ? (rest + tool).slice(0, 3) : rest);
}

// Whether a stroke that starts in a cell adds or removes.
function startsPainting(plan, x, y) {
  return tool === "obstacle" ? !cellText(plan, x, y).includes("#") : !cellText(plan, x, y).includes(tool);
}

// Replace the text of the world.
function change(next, { remember = true } = {}) {
  if (next === text) return;
  if (remember) {
    past.push(text);
    if (past.length > MAX_HISTORY) past.shift();
    future = [];
  }
  text = next;
  if (element("text").value !== text) element("text").value = text;
  show();
  clearTimeout(change.timer);
  change.timer = setTimeout(check, CHECK_DELAY);
}

function edit(make) {
  const plan = parts();
  if (!plan) return;
  make(plan);
  change(joined(plan));
}

function undo(from, to) {
  if (!from.length) return;
  to.push(text);
  change(from.pop(), { remember: false });
}

const ask = (path, body) => fetch(path + location.search, { method: "POST", body, headers: { "Content-Type": "text/plain" } });

async function check() {
  const asked = text;
  try {
    const answer = await (await ask("check", asked)).json();
    if (asked === text) found = answer;
  } catch {
    return; // the notice is shown already
  }
  show();
}

async function save() {
  const asked = text;
  try {
    found = await (await ask("save", asked)).json();
    if (!found.error) [saved, savedHere] = [asked, true];
  } catch {
    notice("Not saved: the server does not answer.");
  }
  show();
}

function notice(words) {
  element("notice").hidden = !words;
  element("notice").textContent = words;
}

// The value of a field above the drawing.
function field(plan, name) {
  const line = plan.fields.find((one) => one.startsWith(`${name}:`));
  return line?.slice(name.length + 1).trim();
}

function setField(name, value) {
  edit((plan) => {
    const at = plan.fields.findIndex((line) => line.startsWith(`${name}:`));
    if (at >= 0) plan.fields[at] = `${name}: ${value}`;
    else plan.fields.splice(plan.fields.findLastIndex((line) => line.includes(":")) + 1, 0, `${name}: ${value}`);
  });
}

// Change the numbers of columns and rows; the upper left corner stays.
function resize(width, height) {
  const plan = parts();
  if (!plan || !(width >= 1 && height >= 1)) return;
  const rows = Array.from({ length: height * ROWS + 1 }, (_, row) =>
    Array.from({ length: width * COLUMNS + 1 }, (_, column) => {
      if (row % ROWS === 0 && column % COLUMNS === 0) return "+";
      if (row === 0 || row === height * ROWS) return "-";
      if (column === 0 || column === width * COLUMNS) return "|";
      const was = plan.rows[row]?.[column] ?? " ";
      const onOldEdge = row === plan.height * ROWS || column === plan.width * COLUMNS;
      return onOldEdge ? " " : was;
    }),
  );
  const before = inventory(text);
  change(joined({ fields: plan.fields, rows }));
  const after = inventory(text);
  const lost = Object.keys(before).filter((kind) => after[kind] < before[kind]);
  const counted = lost.map((kind) => (before[kind] - after[kind] === 1 ? `1 ${kind}` : `${before[kind] - after[kind]} ${PLURALS[kind]}`));
  if (lost.length) showHint(`The smaller plan removed ${counted.join(", ")}. Undo restores the larger one.`);
}

const PLURALS = { robot: "robots", box: "boxes", "warehouse cell": "warehouse cells", obstacle: "obstacles", wall: "walls" };

// Number of objects of each kind in a text, without the outer walls.
function inventory(of) {
  const plan = parts(of);
  const counts = { robot: 0, box: 0, "warehouse cell": 0, obstacle: 0, wall: 0 };
  for (let y = 0; y < plan.height; y++)
    for (let x = 0; x < plan.width; x++) {
      const symbols = cellText(plan, x, y);
      counts.robot += [...symbols].some((sign) => ARROWS.includes(sign));
      counts.box += symbols.includes("o");
      counts["warehouse cell"] += symbols.includes("w");
      counts.obstacle += symbols.includes("#");
      for (const [dx, dy] of [[1, 0], [0, 1]]) {
        const place = wallPlace(plan, x, y, dx, dy);
        counts.wall += Boolean(place && hasWall(plan, place));
      }
    }
  return counts;
}

// Show a hint below the tools.
function showHint(text) {
  element("hint").textContent = text;
}

// The drawing.
const canvas = element("canvas");
const context = canvas.getContext("2d");
let side = 40; // px, of a cell
let shownPlan = parts();

function show() {
  const plan = parts();
  if (plan) shownPlan = plan;
  draw();
  const state = text === saved ? "saved" : "changed";
  element("state").textContent = state === "saved" ? "saved" : saved === null ? "new" : "unsaved";
  element("state").dataset.state = state;
  element("undo").disabled = !past.length;
  element("redo").disabled = !future.length;
  element("save").disabled = Boolean(found.error);
  element("save").title = found.error ? "The error is shown below the plan" : "Ctrl+S";
  element("text").setAttribute("aria-invalid", Boolean(found.error));
  const verdict = element("verdict");
  const unreachable = found.unreachable?.length ?? 0;
  verdict.className = `verdict ${found.error ? "bad" : unreachable || found.connected === false ? "doubt" : ""}`;
  verdict.textContent = found.error
    ? `Cannot be saved: ${found.error}`
    : found.width
      ? `${found.metres[0]} × ${found.metres[1]} m, ${found.boxes} ${found.boxes === 1 ? "box" : "boxes"}${found.drawn ? "" : " at random positions"}` +
        (unreachable ? `. ${unreachable} of them cannot be reached by the robot` : "") +
        (found.connected ? "." : ". Some cells cannot be reached.") +
        (savedHere && state === "saved" ? ` Saved. To deliver in it: wherry deliver --world ${settings.path}` : "")
      : "";
  if (!plan) return;
  const values = { name: field(plan, "name"), cell: field(plan, "cell") ?? 0.6, boxes: field(plan, "boxes") ?? 4, width: plan.width, height: plan.height };
  for (const [name, value] of Object.entries(values)) if (document.activeElement !== element(name)) element(name).value = value ?? "";
}

function draw() {
  const plan = shownPlan;
  if (!plan) return;
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  const room = canvas.parentElement;
  side = Math.max(MIN_CELL_SIZE, Math.min(64, Math.floor((room.clientWidth - 32) / plan.width), Math.floor((room.clientHeight - 32) / plan.height)));
  const ratio = window.devicePixelRatio || 1;
  const [wide, high] = [plan.width * side + 32, plan.height * side + 32];
  canvas.style.width = `${wide}px`;
  canvas.style.height = `${high}px`;
  canvas.width = wide * ratio;
  canvas.height = high * ratio;
  context.setTransform(ratio, 0, 0, ratio, 16 * ratio, 16 * ratio);
  context.fillStyle = colour("free");
  context.fillRect(0, 0, plan.width * side, plan.height * side);
  const box = (x, y, inset, fill) => {
    context.fillStyle = fill;
    context.fillRect(x * side + inset, (plan.height - 1 - y) * side + inset, side - 2 * inset, side - 2 * inset);
  };
  const disc = (x, y, radius, fill) => {
    context.beginPath();
    context.arc((x + 0.5) * side, (plan.height - y - 0.5) * side, radius * side, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
  };
  for (let y = 0; y < plan.height; y++)
    for (let x = 0; x < plan.width; x++) {
      const symbols = cellText(plan, x, y);
      if (symbols.includes("w")) {
        context.globalAlpha = 0.4;
        box(x, y, 1.5, colour("warehouse"));
        context.globalAlpha = 1;
      }
    }
  context.strokeStyle = colour("line");
  context.lineWidth = 1;
  context.beginPath();
  for (let x = 0; x <= plan.width; x++) context.rect(x * side, 0, 0, plan.height * side);
  for (let y = 0; y <= plan.height; y++) context.rect(0, y * side, plan.width * side, 0);
  context.stroke();
  for (let y = 0; y < plan.height; y++)
    for (let x = 0; x < plan.width; x++) if (cellText(plan, x, y).includes("#")) box(x, y, -1, colour("soft")); // covers the grid lines between neighbours
  context.strokeStyle = colour("wall");
  context.lineWidth = Math.max(4, side * 0.11);
  context.lineCap = "square";
  context.beginPath();
  context.rect(0, 0, plan.width * side, plan.height * side);
  for (let y = 0; y < plan.height; y++)
    for (let x = 0; x < plan.width; x++)
      for (const [dx, dy] of [[1, 0], [0, 1]]) {
        const place = wallPlace(plan, x, y, dx, dy);
        if (!place || !hasWall(plan, place)) continue;
        const [left, top] = [x * side, (plan.height - 1 - y) * side];
        if (dx) context.rect(left + side, top, 0, side);
        else context.rect(left, top, side, 0);
      }
  context.stroke();
  for (let y = 0; y < plan.height; y++)
    for (let x = 0; x < plan.width; x++) {
      const symbols = cellText(plan, x, y);
      if (symbols.includes("o")) disc(x, y, 0.24, colour("box"));
      if (found.unreachable?.some(([cx, cy]) => cx === x && cy === y)) mark(plan, x, y, colour("warn"));
      const arrow = [...symbols].find((sign) => ARROWS.includes(sign));
      if (arrow) robot(plan, x, y, (-ARROWS.indexOf(arrow) * Math.PI) / 2, colour("accent"), colour("free"));
      const letter = symbols.match(/[A-Z]/);
      if (letter) {
        context.fillStyle = colour("soft");
        context.font = `600 ${side * 0.36}px system-ui`;
        context.fillText(letter[0], x * side + side * 0.1, (plan.height - y) * side - side * 0.12);
      }
    }
  if (found.error && found.line) markError(plan, colour("particle"));
  if (cursor && document.activeElement === canvas) mark(plan, cursor[0], cursor[1], colour("accent"));
}

function robot(plan, x, y, angle, fill, hollow) {
  context.save();
  context.translate((x + 0.5) * side, (plan.height - y - 0.5) * side);
  context.rotate(angle);
  context.scale(side * 0.34, side * 0.34);
  context.fillStyle = fill;
  context.beginPath();
  for (const [px, py] of [[1, 1], [-0.7, 1], [-1, 0.65], [-1, -0.65], [-0.7, -1], [1, -1], [1, -0.55], [-0.25, -0.55], [-0.25, 0.55], [1, 0.55]]) context.lineTo(px, py);
  context.closePath();
  context.fill();
  context.restore();
}

function mark(plan, x, y, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 3;
  context.strokeRect(x * side + 3, (plan.height - 1 - y) * side + 3, side - 6, side - 6);
}

// A ring around the character at which the server found an error.
function markError(plan, colour) {
  const row = found.line - 1 - plan.fields.length;
  const column = (found.column ?? 1) - 1;
  if (row < 0 || row >= plan.rows.length) return;
  context.strokeStyle = colour;
  context.lineWidth = 3;
  context.beginPath();
  context.arc((column / COLUMNS) * side + (column % COLUMNS ? side / 8 : 0), (row / ROWS) * side, side * 0.42, 0, 2 * Math.PI);
  context.stroke();
}

// The cell under the pointer, its nearest side, and whether that is near.
function under(event) {
  const plan = shownPlan;
  const [px, py] = [(event.offsetX - 16) / side, plan.height - (event.offsetY - 16) / side];
  const [x, y] = [Math.floor(px), Math.floor(py)];
  if (x < 0 || y < 0 || x >= plan.width || y >= plan.height) return null;
  const near = ([distance]) => distance < WALL_REACH;
  const sides = [[px - x, -1, 0], [x + 1 - px, 1, 0], [py - y, 0, -1], [y + 1 - py, 0, 1]].sort((a, b) => a[0] - b[0]);
  const nearest = sides.find(([, dx]) => stroke?.upright === undefined || Boolean(dx) === stroke.upright); // a stroke keeps its direction
  return { x, y, dx: nearest[1], dy: nearest[2], near: near(nearest) };
}

let stroke = null; // {paint, last}
function strokeOn(event) {
  const spot = under(event);
  const plan = parts();
  if (!spot || !plan) return;
  const onWall = tool === "wall" || (tool === "erase" && spot.near && (!stroke.kind || stroke.kind === "wall"));
  if (tool === "wall" && !spot.near) return;
  const key = onWall ? `${spot.x},${spot.y},${spot.dx},${spot.dy}` : `${spot.x},${spot.y}`;
  if (stroke.last === key || (tool === "robot" && stroke.last)) return;
  if (onWall) {
    const place = wallPlace(plan, spot.x, spot.y, spot.dx, spot.dy);
    if (!place) return;
    stroke.paint ??= tool === "wall" && !hasWall(plan, place);
    if (tool === "erase" && !stroke.kind) {
      if (!hasWall(plan, place)) return eraseCell(spot, plan);
      stroke.kind = "wall";
    }
    stroke.upright = Boolean(spot.dx);
    setWall(plan, place, tool === "wall" && stroke.paint);
  } else {
    stroke.kind = "cell";
    stroke.paint ??= startsPainting(plan, spot.x, spot.y);
    drawIn(plan, spot.x, spot.y, stroke.paint);
  }
  stroke.last = key;
  remember(joined(plan));
}

function eraseCell(spot, plan) {
  stroke.kind = "cell";
  drawIn(plan, spot.x, spot.y, false);
  remember(joined(plan));
}

// A whole stroke is one step to undo.
function remember(next) {
  if (next === text) return;
  change(next, { remember: !stroke.changed });
  stroke.changed = true;
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  cursor = null;
  stroke = {};
  strokeOn(event);
});
canvas.addEventListener("pointermove", (event) => stroke && strokeOn(event));
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (stroke = null));

const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
canvas.addEventListener("keydown", (event) => {
  const way = WAYS[event.key];
  const plan = shownPlan;
  cursor ??= [0, plan.height - 1];
  const [x, y] = cursor;
  if (way && event.shiftKey)
    edit((now) => {
      const place = wallPlace(now, x, y, ...way);
      if (place) setWall(now, place, !hasWall(now, place));
    });
  else if (way) cursor = [Math.min(Math.max(x + way[0], 0), plan.width - 1), Math.min(Math.max(y + way[1], 0), plan.height - 1)];
  else if (event.key === " ") edit((now) => tool !== "wall" && drawIn(now, x, y, startsPainting(now, x, y)));
  else return;
  event.preventDefault();
  draw();
});
canvas.addEventListener("focus", draw);
canvas.addEventListener("blur", draw);

document.addEventListener("keydown", (event) => {
  const control = event.ctrlKey || event.metaKey;
  if (control && event.key === "s") save();
  else if (control && event.key.toLowerCase() === "z" && event.target.id !== "text") event.shiftKey ? undo(future, past) : undo(past, future);
  else if (!control && !event.target.closest("input[type=text], input[type=number], textarea") && TOOLS[Number(event.key) - 1]) choose(TOOLS[Number(event.key) - 1][0]);
  else return;
  event.preventDefault();
});

function choose(name) {
  tool = name;
  element(`tool-${name}`).checked = true;
  showHint(TOOLS.find(([other]) => other === name)[3]);
}

for (const [name, words, colour] of TOOLS) {
  const label = document.createElement("label");
  const button = Object.assign(document.createElement("input"), { type: "radio", name: "tool", id: `tool-${name}`, checked: name === tool });
  button.addEventListener("change", () => choose(name));
  const swatch = document.createElement("i");
  swatch.style.setProperty("--c", `var(${colour})`);
  label.append(button, swatch, words);
  element("tools").append(label);
}

element("text").addEventListener("input", () => change(element("text").value));
element("name").addEventListener("input", () => setField("name", element("name").value));
element("cell").addEventListener("input", () => setField("cell", element("cell").value));
element("boxes").addEventListener("input", () => setField("boxes", element("boxes").value));
for (const name of ["width", "height"]) element(name).addEventListener("change", () => resize(Number(element("width").value), Number(element("height").value)));
element("save").addEventListener("click", save);
element("undo").addEventListener("click", () => undo(past, future));
element("redo").addEventListener("click", () => undo(future, past));
element("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  draw();
});
document.documentElement.dataset.theme = new URLSearchParams(location.search).get("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
element("file").textContent = settings.file;
element("text").value = text;
addEventListener("beforeunload", (event) => text !== saved && saved !== null && event.preventDefault());
new ResizeObserver(draw).observe(canvas.parentElement);

// Keep a socket to the server open, and show a notice while it cannot save.
function stay() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket${location.search}`);
  socket.onopen = () => notice("");
  socket.onclose = () => {
    notice("The server does not answer: the file cannot be saved until the editor is started again. Copy the text if you need it.");
    setTimeout(stay, 1500);
  };
}
stay();
choose(tool);
show();
check();
