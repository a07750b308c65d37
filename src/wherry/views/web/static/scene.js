"use strict";
// Draws a trace at one time on the canvas, in layers that can be hidden.

// Label and colour of each layer.
const LAYERS = {
  laser: ["Laser", "--laser"],
  particles: ["Particles", "--particle"],
  path: ["Path", "--path"],
  plan: ["Plan (cells)", "--plan"],
  trail: ["Path driven", "--trail"],
  boxes: ["Boxes", "--box"],
  warehouse: ["Warehouse", "--warehouse"],
  cells: ["Cells", "--soft"],
};
// Label, colour and shape of the symbols that cannot be hidden.
const SYMBOLS = [["Robot, fork ahead", "--robot", "fork"], ["Wall", "--wall", "plain"], ["Free", "--free", "plain"], ["Unknown", "--unknown", "plain"]];
// On a grid without a robot, objects are drawn by the role of their class.
const ROLES = { Robot: "carrier", Taxi: "carrier", Box: "load", Passenger: "load", Destination: "destination", Warehouse: "destination" };
const ROLE_COLOURS = { carrier: "robot", load: "box", destination: "warehouse" };
const LABEL_MIN_CELL = 70; // px, minimum side of a cell at which objects are labelled
const GRID_MIN_CELL = 14; // px, minimum side of a cell at which grid lines are drawn
const TRAIL_DURATION = 90; // s of the trail that is drawn during a delivery; for a log it is drawn whole
const MAX_TRAIL_POINTS = 600;
const MAX_INTERPOLATION = 3; // s between two snapshots above which the pose is not interpolated
const MARGIN = 0.6; // m around the map
const MIN_EXTENT = 4; // m, minimum extent of the fitted view
const WIDE_VIEW = 640; // px, minimum width at which legend and tools are beside the map
const SIDE_PADDING = [156, 56]; // px for legend and tools on the left and right of a wide view
const TOP_PADDING = 50; // px for legend and tools at the top of a narrow view
const PICK_TOLERANCE = 6; // px between a click and an object
const MAX_SCALE = 2000; // px per metre
const MIN_SCALE = 1; // px per metre

// Whether an object is carried by the robot or taxi.
const isCarried = ({ attributes }) => Boolean(attributes.in_bot || attributes.in_taxi);

class Scene {
  constructor(canvas, trace) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.trace = trace;
    this.map = new MapPicture();
    this.mode = "fit"; // "fit", "follow" or "free"
    this.centre = [0, 0]; // m, map frame
    this.scale = 60; // px per metre
    this.hidden = new Set(); // names of hidden layers
    this.selected = null; // as returned by pick()
    this.instant = null; // the records at the shown time
  }

  // Radii of robot and boxes, m; those of the simulation if the trace has none.
  get robotRadius() {
    return this.instant.run?.robot_radius || 0.2;
  }

  get boxRadius() {
    return this.instant.run?.box_radius || 0.1;
  }

  // Read the colours of the theme.
  theme() {
    const style = getComputedStyle(document.documentElement);
    this.colour = (name) => style.getPropertyValue(name).trim();
    this.colours = {};
    for (const name of ["laser", "particle", "path", "plan", "trail", "box", "warehouse", "unknown", "free", "wall", "grid", "robot", "robot-edge", "accent", "soft", "ink"])
      this.colours[name] = this.colour(`--${name}`);
    this.map.setColours(rgb(this.colours.free), rgb(this.colours.wall), rgb(this.colours.unknown));
  }

  resize() {
    const { width, height } = this.canvas.getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.width = width;
    this.height = height;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    this.ratio = this.canvas.width / Math.max(width, 1);
    if (this.mode === "fit") this.fit();
  }

  // Collect what is drawn at a time, with the pose interpolated between two records.
  show(time) {
    const { trace } = this;
    const index = trace.indexAt("RobotSnapshot", time);
    const snapshot = trace.records.RobotSnapshot[index];
    const next = trace.records.RobotSnapshot[index + 1];
    this.map.show(trace.records.MapUpdate, trace.indexAt("MapUpdate", time));
    this.instant = {
      time,
      index,
      snapshot,
      pose: snapshot && interpolated("pose", snapshot, next, time),
      lidar: snapshot && interpolated("lidar", snapshot, next, time),
      cells: trace.at("CellLayout", time),
      step: trace.at("StepTaken", time),
      perceived: trace.at("PerceivedState", time),
      run: trace.records.RunStarted[0],
    };
    if (this.mode === "fit") this.fit();
    if (this.mode === "follow" && this.instant.pose) this.centre = [this.instant.pose[0], this.instant.pose[1]];
  }

  // Fit the view to the path driven and to the map or, without a map, to the cells or the scan.
  fit() {
    const box = unionOf(this.map.extent() ?? this.cellsExtent() ?? this.laserExtent(), this.instant?.snapshot?.drivenExtent);
    if (!box || !this.width) return;
    const [west, south, east, north] = box;
    const [left, right, top] = this.width > WIDE_VIEW ? [...SIDE_PADDING, 0] : [0, 0, TOP_PADDING];
    const horizontal = (this.width - left - right) / Math.max(east - west + 2 * MARGIN, MIN_EXTENT);
    const vertical = (this.height - top) / Math.max(north - south + 2 * MARGIN, MIN_EXTENT);
    this.scale = Math.min(Math.max(Math.min(horizontal, vertical), MIN_SCALE), MAX_SCALE);
    this.centre = [(west + east) / 2 + (right - left) / 2 / this.scale, (south + north) / 2 + top / 2 / this.scale];
  }

  laserExtent() {
    const snapshot = this.instant?.snapshot;
    if (!snapshot?.points.length) return null;
    let box = null;
    for (let n = 0; n < snapshot.points.length; n += 2) {
      const [x, y] = [snapshot.pose[0] + snapshot.points[n] * POSITION_STEP, snapshot.pose[1] + snapshot.points[n + 1] * POSITION_STEP];
      box = unionOf(box, [x, y, x, y]);
    }
    return box;
  }

  cellsExtent() {
    const cells = this.instant?.cells;
    if (!cells || !cells.walls.length) return null;
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let n = 0; n < cells.walls.length; n += 3) {
      // A wall is on the north or east edge of its cell, so it touches the north-east corner.
      const [x, y] = this.inMap(cells, (cells.walls[n] + 1) * cells.size, (cells.walls[n + 1] + 1) * cells.size);
      [box[0], box[1]] = [Math.min(box[0], x), Math.min(box[1], y)];
      [box[2], box[3]] = [Math.max(box[2], x), Math.max(box[3], y)];
    }
    return box;
  }

  // Transform a point from the frame of the cells to the map frame, m.
  inMap(cells, x, y) {
    const [ox, oy, theta] = cells.origin;
    return [ox + Math.cos(theta) * x - Math.sin(theta) * y, oy + Math.sin(theta) * x + Math.cos(theta) * y];
  }

  cellCentre(cells, [x, y]) {
    return this.inMap(cells, (x + 0.5) * cells.size, (y + 0.5) * cells.size);
  }

  // Transform a point from the map frame, m, to pixels of the canvas, and back.
  project(x, y) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  unproject(px, py) {
    return [this.centre[0] + (px - this.width / 2) / this.scale, this.centre[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.unproject(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, MIN_SCALE), MAX_SCALE);
    if (this.mode === "follow") return;
    this.mode = "free";
    this.centre = [x - (px - this.width / 2) / this.scale, y + (py - this.height / 2) / this.scale];
  }

  pan(dx, dy) {
    this.mode = "free";
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
  }

  shows(layer) {
    return !this.hidden.has(layer);
  }

  draw() {
    const { context, instant, colours } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = colours.unknown;
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (!instant) return;
    // From here on coordinates are m in the map frame, y upwards; `px` is the size of a pixel, m.
    const scale = this.scale * this.ratio;
    context.setTransform(scale, 0, 0, -scale, (this.width / 2) * this.ratio - this.centre[0] * scale, (this.height / 2) * this.ratio + this.centre[1] * scale);
    this.px = 1 / this.scale;
    context.lineJoin = context.lineCap = "round";
    this.drawMap();
    if (instant.cells) this.drawCells(instant.cells);
    if (this.shows("trail")) this.drawTrail();
    if (!instant.snapshot) {
      this.drawObjects();
      return;
    }
    if (this.shows("laser")) this.drawLaser();
    if (this.shows("plan")) this.drawPlans();
    if (this.shows("path")) this.drawPath();
    if (this.shows("boxes")) this.drawBoxes();
    this.drawRobot();
    if (this.shows("particles")) this.drawParticles();
    this.drawSelection();
  }

  drawMap() {
    const { context, map } = this;
    if (!map.bounds) return;
    const [x, y, theta] = map.origin;
    const [x0, y0, x1, y1] = map.bounds;
    const side = TILE * map.resolution;
    context.save();
    context.translate(x, y);
    context.rotate(theta);
    context.imageSmoothingEnabled = this.scale * this.ratio * map.resolution < 1.5;
    context.drawImage(map.canvas, x0 * side, y0 * side, (x1 - x0) * side, (y1 - y0) * side);
    context.restore();
  }

  drawCells(cells) {
    const { context } = this;
    const [ox, oy, theta] = cells.origin;
    context.save();
    context.translate(ox, oy);
    context.rotate(theta);
    const [west, south, east, north] = wallBounds(cells.walls).map((bound) => bound * cells.size);
    if (!this.map.bounds) {
      context.fillStyle = this.colours.free;
      context.fillRect(west, south, east - west, north - south);
    }
    if (this.shows("cells") && cells.size * this.scale > GRID_MIN_CELL) this.drawGridLines(cells);
    if (!this.map.bounds) this.drawWalls(cells);
    if (this.shows("warehouse")) this.drawWarehouse(cells);
    context.restore();
  }

  drawGridLines(cells) {
    const { context } = this;
    const [west, south, east, north] = wallBounds(cells.walls);
    const { size } = cells;
    context.beginPath();
    for (let x = west; x <= east; x++) context.rect(x * size, south * size, 0, (north - south) * size);
    for (let y = south; y <= north; y++) context.rect(west * size, y * size, (east - west) * size, 0);
    context.strokeStyle = this.colours.grid;
    context.lineWidth = this.px;
    context.stroke();
  }

  drawWalls({ walls, size }) {
    const { context } = this;
    context.beginPath();
    for (let n = 0; n < walls.length; n += 3) {
      const [x, y, isNorth] = [walls[n] * size, walls[n + 1] * size, walls[n + 2]];
      if (isNorth) context.rect(x, y + size, size, 0);
      else context.rect(x + size, y, 0, size);
    }
    context.strokeStyle = this.colours.wall;
    context.lineWidth = 0.08 * size;
    context.stroke();
  }

  drawWarehouse({ warehouse, size }) {
    for (let n = 0; n < warehouse.length; n += 2)
      this.drawSquare((warehouse[n] + 0.5) * size, (warehouse[n + 1] + 0.5) * size, 0.47 * size, this.colours.warehouse, Math.max(0.02, 1.5 * this.px));
  }

  drawTrail() {
    const { context, trace, instant, px } = this;
    if (!instant.pose) return;
    const snapshots = trace.records.RobotSnapshot;
    const isDelivery = instant.run?.task === "deliver";
    const first = isDelivery ? Math.max(0, trace.indexAt("RobotSnapshot", instant.time - TRAIL_DURATION)) : 0;
    const stride = Math.max(1, Math.floor((instant.index - first) / MAX_TRAIL_POINTS));
    context.beginPath();
    for (let index = first; index <= instant.index; index += stride) context.lineTo(snapshots[index].pose[0], snapshots[index].pose[1]);
    context.lineTo(instant.pose[0], instant.pose[1]);
    context.strokeStyle = this.colours.trail;
    context.globalAlpha = 0.6;
    context.lineWidth = Math.max(0.025, 1.5 * px);
    context.stroke();
    context.globalAlpha = 1;
  }

  drawLaser() {
    const { context, px, colours } = this;
    const { snapshot, lidar } = this.instant;
    const [x, y] = snapshot.pose;
    const { points } = snapshot;
    if (!points.length) return;
    context.beginPath();
    context.moveTo(snapshot.lidar[0], snapshot.lidar[1]);
    for (let n = 0; n < points.length; n += 2) {
      context.lineTo(snapshot.lidar[0], snapshot.lidar[1]);
      context.lineTo(x + points[n] * POSITION_STEP, y + points[n + 1] * POSITION_STEP);
    }
    context.strokeStyle = colours.laser;
    context.globalAlpha = 0.1;
    context.lineWidth = px;
    context.stroke();
    context.globalAlpha = 1;
    const side = Math.max(3 * px, 0.035);
    context.fillStyle = colours.laser;
    context.beginPath();
    for (let n = 0; n < points.length; n += 2)
      context.rect(x + points[n] * POSITION_STEP - side / 2, y + points[n + 1] * POSITION_STEP - side / 2, side, side);
    context.fill();
  }

  // The plan from the robot on; the part after the current leg is drawn paler.
  drawPlans() {
    const { step, pose } = this.instant;
    if (!step || step.plan.length <= 2) return;
    const plan = aheadOf(pose, step.plan);
    const end = legEnd(plan);
    this.drawPlan(plan.subarray(end), 0.25);
    this.drawPlan(plan.subarray(0, end + 2), 0.9);
  }

  drawPath() {
    const { context, px, colours } = this;
    const { snapshot } = this.instant;
    if (snapshot.path.length <= 2) return;
    context.beginPath();
    for (let n = 0; n < snapshot.path.length; n += 2)
      context.lineTo(snapshot.pose[0] + snapshot.path[n] * POSITION_STEP, snapshot.pose[1] + snapshot.path[n + 1] * POSITION_STEP);
    context.strokeStyle = colours.path;
    context.lineWidth = Math.max(0.05, 2.5 * px);
    context.stroke();
  }

  // A dashed line through the cells of a plan, with a disc at its end.
  drawPlan(plan, alpha) {
    if (plan.length < 4) return;
    const { context, px, colours } = this;
    context.beginPath();
    for (let n = 0; n < plan.length; n += 2) context.lineTo(plan[n], plan[n + 1]);
    context.strokeStyle = colours.plan;
    context.globalAlpha = alpha;
    context.lineWidth = Math.max(0.035, 2 * px);
    context.setLineDash([0.1, Math.max(0.1, 6 * px)]);
    context.stroke();
    context.setLineDash([]);
    this.drawDisc(plan[plan.length - 2], plan[plan.length - 1], Math.max(0.07, 4 * px), colours.plan);
    context.globalAlpha = 1;
  }

  drawDisc(x, y, radius, fill, edge) {
    const { context, px } = this;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    if (edge) {
      context.strokeStyle = edge;
      context.lineWidth = 1.5 * px;
      context.stroke();
    }
  }

  // Estimated centres [x, y] of the boxes on the floor, m, map frame.
  boxes() {
    const { snapshot } = this.instant;
    const positions = [];
    if (snapshot)
      for (let n = 0; n < snapshot.boxes.length; n += 2)
        positions.push([snapshot.pose[0] + snapshot.boxes[n] * POSITION_STEP, snapshot.pose[1] + snapshot.boxes[n + 1] * POSITION_STEP]);
    return positions;
  }

  drawBoxes() {
    const radius = Math.max(this.boxRadius, 4 * this.px);
    for (const [x, y] of this.boxes()) this.drawDisc(x, y, radius, this.colours.box, this.colours["robot-edge"]);
  }

  // The robot seen from above: fork, body with the lidar at the back, and the load between the prongs.
  drawRobot() {
    const { context, px, colours, instant } = this;
    const { pose, lidar, snapshot } = instant;
    const radius = Math.max(this.robotRadius, 7 * px);
    const [x, y, theta] = pose;
    context.save();
    context.translate(x, y);
    context.rotate(theta);
    context.scale(radius, radius);
    context.beginPath();
    context.moveTo(0.72, 0.95);
    context.lineTo(-0.62, 0.95);
    context.lineTo(-0.95, 0.6);
    context.lineTo(-0.95, -0.6);
    context.lineTo(-0.62, -0.95);
    context.lineTo(0.72, -0.95);
    context.lineTo(0.72, -0.66);
    context.lineTo(-0.42, -0.66);
    context.lineTo(-0.42, 0.66);
    context.lineTo(0.72, 0.66);
    context.closePath();
    context.fillStyle = colours.robot;
    context.fill();
    context.strokeStyle = colours["robot-edge"];
    context.lineWidth = (1.5 * px) / radius;
    context.stroke();
    context.restore();
    if (snapshot.loaded) this.drawDisc(x, y, radius * 0.5, colours.box, colours["robot-edge"]);
    const magnification = radius / this.robotRadius;
    this.drawDisc(x + (lidar[0] - x) * magnification, y + (lidar[1] - y) * magnification, radius * 0.17, colours.laser);
  }

  drawParticles() {
    const { context, px } = this;
    const { snapshot } = this.instant;
    const [x, y] = snapshot.pose;
    const { particles } = snapshot;
    if (!particles.length) return;
    const length = Math.max(0.1, 6 * px);
    context.beginPath();
    for (let n = 0; n < particles.length; n += 3) {
      const [particleX, particleY, theta] = [x + particles[n] * POSITION_STEP, y + particles[n + 1] * POSITION_STEP, particles[n + 2] * ANGLE_STEP];
      context.moveTo(particleX, particleY);
      context.lineTo(particleX + length * Math.cos(theta), particleY + length * Math.sin(theta));
    }
    context.strokeStyle = this.colours.particle;
    context.globalAlpha = 0.55;
    context.lineWidth = Math.max(0.008, px);
    context.stroke();
    context.globalAlpha = 1;
  }

  // Objects of a grid without a robot: squares for destinations, discs for the carrier and, smaller, for loads.
  drawObjects() {
    const { perceived, cells } = this.instant;
    if (!perceived || !cells) return;
    const objects = perceived.objects.filter(({ attributes }) => attributes.x !== undefined);
    const order = ["destination", "carrier", "load"];
    objects.sort((a, b) => order.indexOf(ROLES[a.className]) - order.indexOf(ROLES[b.className]));
    for (const object of objects) {
      const role = ROLES[object.className] ?? "load";
      const [x, y] = this.cellCentre(cells, this.cellOf(object));
      const fill = this.colours[ROLE_COLOURS[role]];
      if (role === "destination") this.drawSquare(x, y, 0.42 * cells.size, fill, 2 * this.px);
      else this.drawDisc(x, y, (role === "carrier" ? 0.3 : 0.17) * cells.size, fill, this.colours["robot-edge"]);
      const labelOffset = { carrier: 0.34, load: -0.28, destination: -0.39 }[role]; // cells, upwards
      if (cells.size * this.scale >= LABEL_MIN_CELL) this.drawLabel(object.name, x, y + labelOffset * cells.size, role === "carrier" ? fill : this.colours.ink);
    }
    this.drawSelection();
  }

  // The cell of an object; that of the carrier if it is carried, since its own x and y remain those of the pickup.
  cellOf(object) {
    const carrier = isCarried(object) && this.instant.perceived.objects.find(({ className }) => ROLES[className] === "carrier");
    const { x, y } = (carrier || object).attributes;
    return [x, y];
  }

  // A translucent square with an edge around a centre.
  drawSquare(x, y, halfSide, colour, lineWidth) {
    const { context } = this;
    context.beginPath();
    context.rect(x - halfSide, y - halfSide, 2 * halfSide, 2 * halfSide);
    context.globalAlpha = 0.28;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = colour;
    context.lineWidth = lineWidth;
    context.stroke();
  }

  // Text centred at a point of the map.
  drawLabel(text, x, y, fill) {
    const { context } = this;
    const [px, py] = this.project(x, y);
    context.save();
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 4;
    context.strokeStyle = this.colours.free;
    context.strokeText(text, px, py);
    context.fillStyle = fill;
    context.fillText(text, px, py);
    context.restore();
  }

  drawSelection() {
    if (!this.selected) return;
    const circle = this.locate(this.selected);
    if (!circle) return;
    const { context, px, colours } = this;
    context.beginPath();
    context.arc(circle.x, circle.y, Math.max(circle.radius + 4 * px, 9 * px), 0, 2 * Math.PI);
    context.strokeStyle = colours.accent;
    context.lineWidth = 2.5 * px;
    context.stroke();
  }

  // The object or point of the map at a pixel, as {kind, …}; null where the map is unknown.
  pick(px, py) {
    const { instant } = this;
    if (!instant) return null;
    const [x, y] = this.unproject(px, py);
    const tolerance = PICK_TOLERANCE / this.scale;
    const isNear = (ox, oy, radius) => Math.hypot(x - ox, y - oy) <= radius + tolerance;
    if (instant.pose && isNear(instant.pose[0], instant.pose[1], this.robotRadius)) return { kind: "robot" };
    const box = this.boxes().find(([bx, by]) => isNear(bx, by, this.boxRadius));
    if (box) return { kind: "box", name: this.nameOfBox(box), x: box[0], y: box[1] };
    if (instant.cells) {
      const [cx, cy] = this.cellAt(instant.cells, x, y);
      const object = !instant.snapshot && instant.perceived?.objects.find((item) => this.cellOf(item).join() === `${cx},${cy}`);
      if (object) return { kind: "object", name: object.name };
      const { warehouse } = instant.cells;
      for (let n = 0; n < warehouse.length; n += 2)
        if (warehouse[n] === cx && warehouse[n + 1] === cy) return { kind: "warehouse", cell: [cx, cy] };
    }
    return this.map.percentAt(x, y) === null ? null : { kind: "point", x, y };
  }

  // All objects that can be selected, in the order of the O key.
  pickable() {
    const { instant } = this;
    const objects = instant?.pose ? [{ kind: "robot" }] : (instant?.perceived?.objects ?? []).map(({ name }) => ({ kind: "object", name }));
    for (const box of this.boxes()) objects.push({ kind: "box", name: this.nameOfBox(box), x: box[0], y: box[1] });
    const warehouse = instant?.cells?.warehouse ?? [];
    for (let n = 0; n < warehouse.length; n += 2) objects.push({ kind: "warehouse", cell: [warehouse[n], warehouse[n + 1]] });
    return objects;
  }

  pickNext() {
    const objects = this.pickable();
    const key = (object) => JSON.stringify([object.kind, object.name, object.cell]);
    const current = this.selected ? objects.findIndex((object) => key(object) === key(this.selected)) : -1;
    this.selected = objects[(current + 1) % objects.length] ?? null;
  }

  // The cell that contains a point of the map frame, m.
  cellAt(cells, x, y) {
    const [ox, oy, theta] = cells.origin;
    const [dx, dy] = [x - ox, y - oy];
    return [
      Math.floor((Math.cos(theta) * dx + Math.sin(theta) * dy) / cells.size),
      Math.floor((Math.cos(theta) * dy - Math.sin(theta) * dx) / cells.size),
    ];
  }

  // Name of the box at a position, from the perceived state.
  nameOfBox([x, y]) {
    const { cells, perceived } = this.instant;
    if (!cells || !perceived) return null;
    const [cx, cy] = this.cellAt(cells, x, y);
    const box = perceived.objects.find(({ className, attributes }) => className === "Box" && attributes.x === cx && attributes.y === cy);
    return box?.name ?? null;
  }

  // Centre and radius of a selected object, m, map frame; null if it does not exist any more.
  locate(selection) {
    const { instant } = this;
    const { cells, perceived, pose } = instant;
    if (selection.kind === "robot") return pose && { x: pose[0], y: pose[1], radius: this.robotRadius };
    if (selection.kind === "point") return { x: selection.x, y: selection.y, radius: 0 };
    if (selection.kind === "warehouse" && cells) {
      const [x, y] = this.cellCentre(cells, selection.cell);
      return { x, y, radius: cells.size / 2 };
    }
    if (selection.kind === "box") {
      const object = perceived?.objects.find((item) => item.name === selection.name);
      if (object?.attributes.in_bot) return pose && { x: pose[0], y: pose[1], radius: this.boxRadius };
      const nearest = this.boxes().find((box) => (selection.name ? this.nameOfBox(box) === selection.name : Math.hypot(box[0] - selection.x, box[1] - selection.y) < 0.3));
      return nearest ? { x: nearest[0], y: nearest[1], radius: this.boxRadius } : null;
    }
    const object = perceived?.objects.find((item) => item.name === selection.name);
    if (!object || !cells) return null;
    const [x, y] = this.cellCentre(cells, this.cellOf(object));
    return { x, y, radius: cells.size / 3 };
  }
}

// The plan from the robot on: its first segment begins at the robot if the robot is on it.
function aheadOf([x, y], plan) {
  const [x0, y0, x1, y1] = plan;
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (!length) return plan;
  const along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length;
  const aside = Math.abs((x - x0) * (y1 - y0) - (y - y0) * (x1 - x0)) / length;
  if (aside > length / 4 || along <= 0 || along >= length) return plan;
  const ahead = plan.slice();
  ahead.set([x, y]);
  return ahead;
}

// Index at which the current leg of a plan ends: the first cell after a move where the robot stays, to pick up or drop.
function legEnd(plan) {
  let moved = false;
  for (let n = 2; n < plan.length; n += 2) {
    const stays = plan[n] === plan[n - 2] && plan[n + 1] === plan[n - 1];
    if (stays && moved) return n - 2;
    moved ||= !stays;
  }
  return plan.length - 2;
}

// A pose of a snapshot, "pose" or "lidar", interpolated linearly to the next snapshot.
function interpolated(name, snapshot, next, time) {
  const from = snapshot[name];
  if (!next || next.time - snapshot.time > MAX_INTERPOLATION || time <= snapshot.time) return from;
  const fraction = Math.min((time - snapshot.time) / (next.time - snapshot.time), 1);
  const [x, y, theta] = next[name];
  const turn = Math.atan2(Math.sin(theta - from[2]), Math.cos(theta - from[2]));
  return [from[0] + (x - from[0]) * fraction, from[1] + (y - from[1]) * fraction, from[2] + turn * fraction];
}

// Bounds of the area enclosed by walls, cells, as [west, south, east, north].
function wallBounds(walls) {
  let [west, south, east, north] = [Infinity, Infinity, -Infinity, -Infinity];
  for (let n = 0; n < walls.length; n += 3) {
    // A wall is on the north or east edge of its cell, so it touches the north-east corner.
    [west, east] = [Math.min(west, walls[n] + 1), Math.max(east, walls[n] + 1)];
    [south, north] = [Math.min(south, walls[n + 1] + 1), Math.max(north, walls[n + 1] + 1)];
  }
  return [west, south, east, north];
}

// The channels [r, g, b] of a colour #rgb or #rrggbb.
function rgb(colour) {
  const short = colour.slice(1);
  const digits = short.length < 6 ? [...short].map((digit) => digit + digit).join("") : short;
  return [0, 2, 4].map((start) => parseInt(digits.slice(start, start + 2), 16));
}
