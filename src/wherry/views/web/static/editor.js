"use strict";
// Edits a world file. The text is the only model: drawing changes its characters, and the server checks the result.

const CELL_COLUMNS = 4; // characters from one wall to the next
const CELL_LINES = 2; // lines from one wall to the next
const CHECK_DELAY = 120; // ms between the last change and its check
const RECONNECT_DELAY = 1500; // ms
const MAX_HISTORY = 300; // changes that can be undone
const MIN_CELL_SIZE = 14; // px, minimum side of a drawn cell; larger plans scroll
const MAX_CELL_SIZE = 64; // px, maximum side of a drawn cell
const MARGIN = 16; // px around the drawn plan
const EDGE_TOLERANCE = 0.26; // cells between the pointer and an edge on which it draws a wall

// Name, label, colour and hint of each tool.
const TOOLS = [
  ["wall", "Wall", "--wall", "Click the edge of a cell, or drag along several; on a wall, this removes it."],
  ["obstacle", "Obstacle", "--soft", "Click a cell, or drag over several; on an obstacle, this removes it."],
  ["w", "Warehouse", "--warehouse", "Click the cells to which boxes are delivered."],
  ["o", "Box", "--box", "Click the cells where boxes stand; without any, boxes are placed at random."],
  ["robot", "Robot", "--accent", "Click the cell where the robot starts; a second click turns it."],
  ["erase", "Erase", "--particle", "Click a wall or a cell to clear it."],
];
const HEADINGS = ">^<v"; // symbols of the robot, counterclockwise

let text = settings.text;
let savedText = settings.new ? null : settings.text; // content of the file
let savedHere = false; // whether this page has saved the file
let past = []; // texts that undo restores
let future = []; // texts that redo restores
let tool = "wall";
let cursor = null; // cell [x, y] of the keyboard cursor
let checked = { error: null, unreachable: [] }; // the server's check of the text, see check_world() in editor.py

// Fields, and drawing as rows of characters, of a text; null if the drawing is not a rectangle of cells.
function parsePlan(source = text) {
  const lines = source.replace(/\s+$/, "").split("\n").map((line) => line.trimEnd());
  const first = lines.findIndex((line) => line.startsWith("+"));
  if (first < 0) return null;
  const drawing = lines.slice(first);
  const characters = drawing[0].length;
  if (characters % CELL_COLUMNS !== 1 || characters <= CELL_COLUMNS) return null;
  if (drawing.length % CELL_LINES !== 1 || drawing.length <= CELL_LINES) return null;
  if (drawing.some((line) => line.length !== characters)) return null;
  const rows = drawing.map((line) => [...line]);
  return { fields: lines.slice(0, first), rows, width: (characters - 1) / CELL_COLUMNS, height: (drawing.length - 1) / CELL_LINES };
}

const formatPlan = ({ fields, rows }) => [...fields, ...rows.map((row) => row.join(""))].join("\n") + "\n";
const rowOf = (plan, y) => (plan.height - 1 - y) * CELL_LINES + 1;
const columnOf = (x) => x * CELL_COLUMNS + 1;
const cellSymbols = (plan, x, y) => plan.rows[rowOf(plan, y)].slice(columnOf(x), columnOf(x) + CELL_COLUMNS - 1).join("");

// Write up to three symbols into a cell, centred.
function setCell(plan, x, y, symbols) {
  const padded = symbols.padStart(Math.ceil((3 + symbols.length) / 2)).padEnd(3);
  [...padded].forEach((symbol, index) => (plan.rows[rowOf(plan, y)][columnOf(x) + index] = symbol));
}

// Row, column and characters of the wall between a cell and its neighbour at (dx, dy); null on the outer edge.
function wallBetween(plan, x, y, dx, dy) {
  if (x + dx < 0 || x + dx >= plan.width || y + dy < 0 || y + dy >= plan.height) return null;
  const row = rowOf(plan, y) - dy;
  return dx ? [row, columnOf(x) + (dx > 0 ? CELL_COLUMNS - 1 : -1), "|"] : [row, columnOf(x), "---"];
}

function hasWall(plan, [row, column, wall]) {
  return plan.rows[row].slice(column, column + wall.length).join("") === wall;
}

function setWall(plan, [row, column, wall], isPresent) {
  [...wall].forEach((symbol, index) => (plan.rows[row][column + index] = isPresent ? symbol : " "));
}

// Apply the tool to a cell: add its symbol, or remove it.
function applyTool(plan, x, y, isAdding) {
  const symbols = cellSymbols(plan, x, y).replaceAll(" ", "");
  if (tool === "erase") return setCell(plan, x, y, "");
  if (tool === "obstacle") return setCell(plan, x, y, isAdding ? "###" : "");
  if (tool === "robot") return placeRobot(plan, x, y, symbols);
  const others = symbols.replaceAll(tool, "").replace("###", "");
  return setCell(plan, x, y, isAdding ? (others + tool).slice(0, 3) : others);
}

// Move the robot to a cell or, if it is there, turn it to the left.
function placeRobot(plan, x, y, symbols) {
  for (const [column, row] of cellsOf(plan)) {
    const there = cellSymbols(plan, column, row);
    if ((column !== x || row !== y) && headingIn(there)) setCell(plan, column, row, there.replace(/[>^<v ]/g, ""));
  }
  const heading = headingIn(symbols);
  const next = heading ? HEADINGS[(HEADINGS.indexOf(heading) + 1) % 4] : ">";
  const marks = symbols.replace(/[^A-Z]/g, "");
  setCell(plan, x, y, next + (symbols.includes("w") ? "w" : "") + marks);
}

const headingIn = (symbols) => [...symbols].find((symbol) => HEADINGS.includes(symbol));

function* cellsOf(plan) {
  for (let y = 0; y < plan.height; y++) for (let x = 0; x < plan.width; x++) yield [x, y];
}

// Whether a stroke that starts in a cell adds the tool's symbol, instead of removing it.
function startsAdding(plan, x, y) {
  return tool === "obstacle" ? !cellSymbols(plan, x, y).includes("#") : !cellSymbols(plan, x, y).includes(tool);
}

// Replace the text of the world.
function change(next, { isUndoable = true } = {}) {
  if (next === text) return;
  if (isUndoable) {
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

// Change the text by a function that changes its plan.
function edit(changePlan) {
  const plan = parsePlan();
  if (!plan) return;
  changePlan(plan);
  change(formatPlan(plan));
}

// Restore the last text of one history, and add the current one to the other.
function restore(from, to) {
  if (!from.length) return;
  to.push(text);
  change(from.pop(), { isUndoable: false });
}

const post = (path, body) => fetch(path + location.search, { method: "POST", body, headers: { "Content-Type": "text/plain" } });

async function check() {
  const sent = text;
  try {
    const result = await (await post("check", sent)).json();
    if (sent === text) checked = result;
  } catch {
    return; // connect() shows a notice that the server does not answer
  }
  show();
}

async function save() {
  const sent = text;
  try {
    checked = await (await post("save", sent)).json();
    if (!checked.error) [savedText, savedHere] = [sent, true];
  } catch {
    showNotice("Not saved: the server does not answer.");
  }
  show();
}

function showNotice(message) {
  element("notice").hidden = !message;
  element("notice").textContent = message;
}

// The value of a field above the drawing.
function field(plan, name) {
  const line = plan.fields.find((candidate) => candidate.startsWith(`${name}:`));
  return line?.slice(name.length + 1).trim();
}

function setField(name, value) {
  edit((plan) => {
    const index = plan.fields.findIndex((line) => line.startsWith(`${name}:`));
    if (index >= 0) plan.fields[index] = `${name}: ${value}`;
    else plan.fields.splice(plan.fields.findLastIndex((line) => line.includes(":")) + 1, 0, `${name}: ${value}`);
  });
}

// Change the numbers of columns and rows; the upper left corner stays.
function resize(width, height) {
  const plan = parsePlan();
  if (!plan || !(width >= 1 && height >= 1)) return;
  const rows = Array.from({ length: height * CELL_LINES + 1 }, (_, row) =>
    Array.from({ length: width * CELL_COLUMNS + 1 }, (_, column) => {
      if (row % CELL_LINES === 0 && column % CELL_COLUMNS === 0) return "+";
      if (row === 0 || row === height * CELL_LINES) return "-";
      if (column === 0 || column === width * CELL_COLUMNS) return "|";
      const isOldEdge = row === plan.height * CELL_LINES || column === plan.width * CELL_COLUMNS;
      return isOldEdge ? " " : (plan.rows[row]?.[column] ?? " ");
    }),
  );
  const before = countObjects(text);
  change(formatPlan({ fields: plan.fields, rows }));
  const after = countObjects(text);
  const lost = Object.keys(before).filter((name) => after[name] < before[name]);
  const counts = lost.map((name) => (before[name] - after[name] === 1 ? `1 ${name}` : `${before[name] - after[name]} ${PLURALS[name]}`));
  if (lost.length) showHint(`The smaller plan removed ${counts.join(", ")}. Undo restores the larger one.`);
}

const PLURALS = { robot: "robots", box: "boxes", "warehouse cell": "warehouse cells", obstacle: "obstacles", wall: "walls" };

// Number of objects in a text by their name, without the outer walls.
function countObjects(source) {
  const plan = parsePlan(source);
  const counts = { robot: 0, box: 0, "warehouse cell": 0, obstacle: 0, wall: 0 };
  for (const [x, y] of cellsOf(plan)) {
    const symbols = cellSymbols(plan, x, y);
    counts.robot += Boolean(headingIn(symbols));
    counts.box += symbols.includes("o");
    counts["warehouse cell"] += symbols.includes("w");
    counts.obstacle += symbols.includes("#");
    for (const [dx, dy] of [[1, 0], [0, 1]]) {
      const wall = wallBetween(plan, x, y, dx, dy);
      counts.wall += Boolean(wall && hasWall(plan, wall));
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
let side = 40; // px, side of a drawn cell
let shownPlan = parsePlan(); // the last plan that could be parsed

function show() {
  const plan = parsePlan();
  if (plan) shownPlan = plan;
  draw();
  const state = text === savedText ? "saved" : "changed";
  element("state").textContent = state === "saved" ? "saved" : savedText === null ? "new" : "unsaved";
  element("state").dataset.state = state;
  element("undo").disabled = !past.length;
  element("redo").disabled = !future.length;
  element("save").disabled = Boolean(checked.error);
  element("save").title = checked.error ? "The error is shown below the plan" : "Ctrl+S";
  element("text").setAttribute("aria-invalid", Boolean(checked.error));
  const isDoubtful = checked.unreachable?.length || checked.connected === false;
  element("verdict").className = `verdict ${checked.error ? "bad" : isDoubtful ? "doubt" : ""}`;
  element("verdict").textContent = verdictText(state);
  if (!plan) return;
  const values = { name: field(plan, "name"), cell: field(plan, "cell") ?? 0.6, boxes: field(plan, "boxes") ?? 4, width: plan.width, height: plan.height };
  for (const [name, value] of Object.entries(values)) if (document.activeElement !== element(name)) element(name).value = value ?? "";
}

// The result of the check as a sentence.
function verdictText(state) {
  if (checked.error) return `Cannot be saved: ${checked.error}`;
  if (!checked.width) return "";
  const unreachable = checked.unreachable.length;
  return (
    `${checked.metres[0]} × ${checked.metres[1]} m, ${checked.boxes} ${checked.boxes === 1 ? "box" : "boxes"}${checked.drawn ? "" : " at random positions"}` +
    (unreachable ? `. ${unreachable} of them cannot be reached by the robot` : "") +
    (checked.connected ? "." : ". Some cells cannot be reached.") +
    (savedHere && state === "saved" ? ` Saved. To deliver in it: wherry deliver --world ${settings.path}` : "")
  );
}

const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function draw() {
  const plan = shownPlan;
  if (!plan) return;
  fitCanvas(plan);
  context.fillStyle = colourOf("free");
  context.fillRect(0, 0, plan.width * side, plan.height * side);
  const cells = [...cellsOf(plan)];
  const cellsWith = (symbol) => cells.filter(([x, y]) => cellSymbols(plan, x, y).includes(symbol));
  context.globalAlpha = 0.4;
  for (const [x, y] of cellsWith("w")) fillCell(plan, x, y, 1.5, colourOf("warehouse"));
  context.globalAlpha = 1;
  drawGridLines(plan);
  for (const [x, y] of cellsWith("#")) fillCell(plan, x, y, -1, colourOf("soft")); // covers the grid lines between neighbours
  drawWalls(plan, cells);
  for (const [x, y] of cellsWith("o")) drawBox(plan, x, y);
  for (const [x, y] of checked.unreachable ?? []) markCell(plan, x, y, colourOf("warn"));
  for (const [x, y] of cells) drawRobotAndMark(plan, x, y);
  if (checked.error && checked.line) markError(plan, colourOf("particle"));
  if (cursor && document.activeElement === canvas) markCell(plan, cursor[0], cursor[1], colourOf("accent"));
}

// Choose the size of a cell, and scale the canvas to it.
function fitCanvas(plan) {
  const { clientWidth, clientHeight } = canvas.parentElement;
  const largest = Math.min(Math.floor((clientWidth - 2 * MARGIN) / plan.width), Math.floor((clientHeight - 2 * MARGIN) / plan.height));
  side = Math.max(MIN_CELL_SIZE, Math.min(MAX_CELL_SIZE, largest));
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [plan.width * side + 2 * MARGIN, plan.height * side + 2 * MARGIN];
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  context.setTransform(ratio, 0, 0, ratio, MARGIN * ratio, MARGIN * ratio);
}

function fillCell(plan, x, y, inset, fill) {
  context.fillStyle = fill;
  context.fillRect(x * side + inset, (plan.height - 1 - y) * side + inset, side - 2 * inset, side - 2 * inset);
}

function drawBox(plan, x, y) {
  context.beginPath();
  context.arc((x + 0.5) * side, (plan.height - y - 0.5) * side, 0.24 * side, 0, 2 * Math.PI);
  context.fillStyle = colourOf("box");
  context.fill();
}

function drawGridLines(plan) {
  context.strokeStyle = colourOf("line");
  context.lineWidth = 1;
  context.beginPath();
  for (let x = 0; x <= plan.width; x++) context.rect(x * side, 0, 0, plan.height * side);
  for (let y = 0; y <= plan.height; y++) context.rect(0, y * side, plan.width * side, 0);
  context.stroke();
}

function drawWalls(plan, cells) {
  context.strokeStyle = colourOf("wall");
  context.lineWidth = Math.max(4, side * 0.11);
  context.lineCap = "square";
  context.beginPath();
  context.rect(0, 0, plan.width * side, plan.height * side);
  for (const [x, y] of cells)
    for (const [dx, dy] of [[1, 0], [0, 1]]) {
      const wall = wallBetween(plan, x, y, dx, dy);
      if (!wall || !hasWall(plan, wall)) continue;
      const [left, top] = [x * side, (plan.height - 1 - y) * side];
      if (dx) context.rect(left + side, top, 0, side);
      else context.rect(left, top, side, 0);
    }
  context.stroke();
}

// The robot and the letter of a cell, if the cell has them.
function drawRobotAndMark(plan, x, y) {
  const symbols = cellSymbols(plan, x, y);
  const heading = headingIn(symbols);
  if (heading) drawRobot(plan, x, y, (-HEADINGS.indexOf(heading) * Math.PI) / 2, colourOf("accent"));
  const letter = symbols.match(/[A-Z]/);
  if (!letter) return;
  context.fillStyle = colourOf("soft");
  context.font = `600 ${side * 0.36}px system-ui`;
  context.fillText(letter[0], x * side + side * 0.1, (plan.height - y) * side - side * 0.12);
}

// The robot seen from above, turned by an angle, rad, clockwise on the screen.
function drawRobot(plan, x, y, angle, fill) {
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

// Frame a cell.
function markCell(plan, x, y, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 3;
  context.strokeRect(x * side + 3, (plan.height - 1 - y) * side + 3, side - 6, side - 6);
}

// A ring around the character at which the server found an error.
function markError(plan, colour) {
  const row = checked.line - 1 - plan.fields.length;
  const column = (checked.column ?? 1) - 1;
  if (row < 0 || row >= plan.rows.length) return;
  context.strokeStyle = colour;
  context.lineWidth = 3;
  context.beginPath();
  context.arc((column / CELL_COLUMNS) * side + (column % CELL_COLUMNS ? side / 8 : 0), (row / CELL_LINES) * side, side * 0.42, 0, 2 * Math.PI);
  context.stroke();
}

// The cell under the pointer, and the direction and nearness of the closest edge.
function locate(event) {
  const plan = shownPlan;
  const [px, py] = [(event.offsetX - MARGIN) / side, plan.height - (event.offsetY - MARGIN) / side];
  const [x, y] = [Math.floor(px), Math.floor(py)];
  if (x < 0 || y < 0 || x >= plan.width || y >= plan.height) return null;
  const edges = [[px - x, -1, 0], [x + 1 - px, 1, 0], [py - y, 0, -1], [y + 1 - py, 0, 1]].sort((a, b) => a[0] - b[0]);
  // The walls of a stroke are all vertical or all horizontal.
  const [distance, dx, dy] = edges.find(([, dx]) => stroke?.isVertical === undefined || Boolean(dx) === stroke.isVertical);
  return { x, y, dx, dy, isNearEdge: distance < EDGE_TOLERANCE };
}

// The stroke that is being drawn: {isAdding, target ("wall" or "cell"), isVertical, lastKey, hasChanged}.
let stroke = null;
function continueStroke(event) {
  const spot = locate(event);
  const plan = parsePlan();
  if (!spot || !plan) return;
  const isWall = tool === "wall" || (tool === "erase" && spot.isNearEdge && stroke.target !== "cell");
  if (tool === "wall" && !spot.isNearEdge) return;
  const key = isWall ? `${spot.x},${spot.y},${spot.dx},${spot.dy}` : `${spot.x},${spot.y}`;
  if (stroke.lastKey === key || (tool === "robot" && stroke.lastKey)) return;
  if (isWall) {
    const wall = wallBetween(plan, spot.x, spot.y, spot.dx, spot.dy);
    if (!wall) return;
    stroke.isAdding ??= tool === "wall" && !hasWall(plan, wall);
    if (tool === "erase" && !stroke.target) {
      if (!hasWall(plan, wall)) return eraseCell(spot, plan);
      stroke.target = "wall";
    }
    stroke.isVertical = Boolean(spot.dx);
    setWall(plan, wall, tool === "wall" && stroke.isAdding);
  } else {
    stroke.target = "cell";
    stroke.isAdding ??= startsAdding(plan, spot.x, spot.y);
    applyTool(plan, spot.x, spot.y, stroke.isAdding);
  }
  stroke.lastKey = key;
  changeInStroke(formatPlan(plan));
}

function eraseCell(spot, plan) {
  stroke.target = "cell";
  applyTool(plan, spot.x, spot.y, false);
  changeInStroke(formatPlan(plan));
}

// Change the text such that one undo restores the text before the whole stroke.
function changeInStroke(next) {
  if (next === text) return;
  change(next, { isUndoable: !stroke.hasChanged });
  stroke.hasChanged = true;
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  cursor = null;
  stroke = {};
  continueStroke(event);
});
canvas.addEventListener("pointermove", (event) => stroke && continueStroke(event));
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (stroke = null));

const ARROW_KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
canvas.addEventListener("keydown", (event) => {
  const direction = ARROW_KEYS[event.key];
  const plan = shownPlan;
  cursor ??= [0, plan.height - 1];
  const [x, y] = cursor;
  if (direction && event.shiftKey)
    edit((edited) => {
      const wall = wallBetween(edited, x, y, ...direction);
      if (wall) setWall(edited, wall, !hasWall(edited, wall));
    });
  else if (direction) cursor = [Math.min(Math.max(x + direction[0], 0), plan.width - 1), Math.min(Math.max(y + direction[1], 0), plan.height - 1)];
  else if (event.key === " ") edit((edited) => tool !== "wall" && applyTool(edited, x, y, startsAdding(edited, x, y)));
  else return;
  event.preventDefault();
  draw();
});
canvas.addEventListener("focus", draw);
canvas.addEventListener("blur", draw);

document.addEventListener("keydown", (event) => {
  const control = event.ctrlKey || event.metaKey;
  if (control && event.key === "s") save();
  else if (control && event.key.toLowerCase() === "z" && event.target.id !== "text") event.shiftKey ? restore(future, past) : restore(past, future);
  else if (!control && !event.target.closest("input[type=text], input[type=number], textarea") && TOOLS[Number(event.key) - 1]) choose(TOOLS[Number(event.key) - 1][0]);
  else return;
  event.preventDefault();
});

function choose(name) {
  tool = name;
  element(`tool-${name}`).checked = true;
  showHint(TOOLS.find(([other]) => other === name)[3]);
}

for (const [name, label, colour] of TOOLS) {
  const button = Object.assign(document.createElement("input"), { type: "radio", name: "tool", id: `tool-${name}`, checked: name === tool });
  button.addEventListener("change", () => choose(name));
  element("tools").append(make("label", "", button, swatch(`var(${colour})`), label));
}

element("text").addEventListener("input", () => change(element("text").value));
element("name").addEventListener("input", () => setField("name", element("name").value));
element("cell").addEventListener("input", () => setField("cell", element("cell").value));
element("boxes").addEventListener("input", () => setField("boxes", element("boxes").value));
for (const name of ["width", "height"]) element(name).addEventListener("change", () => resize(Number(element("width").value), Number(element("height").value)));
element("save").addEventListener("click", save);
element("undo").addEventListener("click", () => restore(past, future));
element("redo").addEventListener("click", () => restore(future, past));
element("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  draw();
});
document.documentElement.dataset.theme = new URLSearchParams(location.search).get("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
element("file").textContent = settings.file;
element("text").value = text;
addEventListener("beforeunload", (event) => text !== savedText && savedText !== null && event.preventDefault());
new ResizeObserver(draw).observe(canvas.parentElement);

// Keep a socket to the server open, so that it counts the page, and show a notice while it does not answer.
function connect() {
  const socket = new WebSocket(socketUrl(location.search.slice(1)));
  socket.onopen = () => showNotice("");
  socket.onclose = () => {
    showNotice("The server does not answer: the file cannot be saved until the editor is started again. Copy the text if you need it.");
    setTimeout(connect, RECONNECT_DELAY);
  };
}
connect();
choose(tool);
show();
check();
