"use strict";
// Draws a trace at one time: map, cells, warehouse, trail, laser, plan, path, boxes, robot, particles.

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
// Symbols that cannot be hidden. On a grid without a robot, objects are drawn by their class.
const SYMBOLS = [["Robot, fork at the front", "--robot", "fork"], ["Wall", "--wall", "plain"], ["Free", "--free", "plain"], ["Unknown", "--unknown", "plain"]];
const KINDS = { Robot: "carrier", Taxi: "carrier", Box: "load", Passenger: "load", Destination: "place", Warehouse: "place" };
const KIND_COLOURS = { carrier: "robot", load: "box", place: "warehouse" };
const LABEL_MIN_CELL = 70; // px, side of a cell from which on objects are labelled
const TRAIL_DURATION = 90; // s, of a delivery; of a log the whole trail is shown
const MARGIN = 0.6; // m around the map
const MIN_EXTENT = 4; // m, least extent of the fitted view
const SIDE_PADDING = [156, 56]; // px for legend and tools on the left and right of a wide view
const TOP_PADDING = 50; // px for them at the top of a narrow view
const MAX_SCALE = 2000; // px per metre
const MIN_SCALE = 1; // px per metre

// Whether an object is carried by the robot or taxi.
const isCarried = ({ values }) => Boolean(values.in_bot || values.in_taxi);

class Scene {
  constructor(canvas, trace) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.trace = trace;
    this.map = new MapPicture();
    this.mode = "fit"; // "fit", "follow" or "free"
    this.centre = [0, 0]; // m, map frame
    this.scale = 60; // px per metre
    this.hidden = new Set();
    this.selected = null;
    this.instant = null;
  }

  // m; that of the simulated robot where the trace gives none.
  get robotRadius() {
    return this.instant.began?.robot_radius || 0.2;
  }

  get boxRadius() {
    return this.instant.began?.box_radius || 0.1;
  }

  // Read the colours of the theme.
  theme() {
    const style = getComputedStyle(document.documentElement);
    this.colour = (name) => style.getPropertyValue(name).trim();
    this.colours = {};
    for (const name of ["laser", "particle", "path", "plan", "trail", "box", "warehouse", "unknown", "free", "wall", "grid", "robot", "robot-edge", "accent", "soft", "ink"])
      this.colours[name] = this.colour(`--${name}`);
    this.map.paint(rgb(this.colours.free), rgb(this.colours.wall), rgb(this.colours.unknown));
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
    const at = trace.indexAt("Seen", time);
    const seen = trace.records.Seen[at];
    this.map.show(trace.records.Explored, trace.indexAt("Explored", time));
    this.instant = {
      time,
      at,
      seen,
      pose: seen && interpolated(seen.pose, seen.time, trace.records.Seen[at + 1], "pose", time),
      lidar: seen && interpolated(seen.lidar, seen.time, trace.records.Seen[at + 1], "lidar", time),
      cells: trace.at("CellsLaid", time),
      step: trace.at("Stepped", time),
      perceived: trace.at("Perceived", time),
      began: trace.records.Began[0],
    };
    if (this.mode === "fit") this.fit();
    if (this.mode === "follow" && this.instant.pose) this.centre = [this.instant.pose[0], this.instant.pose[1]];
  }

  // Fit the view to the map, or else the cells or the scan, and to the path driven.
  fit() {
    const box = unionOf(this.map.extent() ?? this.cellsExtent() ?? this.laserExtent(), this.instant?.seen?.reach);
    if (!box || !this.width) return;
    const [west, south, east, north] = box;
    const [left, right, top] = this.width > 640 ? [...SIDE_PADDING, 0] : [0, 0, TOP_PADDING];
    const across = Math.min((this.width - left - right) / Math.max(east - west + 2 * MARGIN, MIN_EXTENT), (this.height - top) / Math.max(north - south + 2 * MARGIN, MIN_EXTENT));
    this.scale = Math.min(Math.max(across, MIN_SCALE), MAX_SCALE);
    this.centre = [(west + east) / 2 + (right - left) / 2 / this.scale, (south + north) / 2 + top / 2 / this.scale];
  }

  laserExtent() {
    const seen = this.instant?.seen;
    if (!seen?.points.length) return null;
    let box = null;
    for (let n = 0; n < seen.points.length; n += 2) {
      const [x, y] = [seen.pose[0] + seen.points[n] * POSITION_STEP, seen.pose[1] + seen.points[n + 1] * POSITION_STEP];
      box = unionOf(box, [x, y, x, y]);
    }
    return box;
  }

  cellsExtent() {
    const cells = this.instant?.cells;
    if (!cells || !cells.walls.length) return null;
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let n = 0; n < cells.walls.length; n += 3) {
      // Walls are on north and east edges, so that each wall touches the north-east corner of its cell.
      const [x, y] = this.inMap(cells, (cells.walls[n] + 1) * cells.size, (cells.walls[n + 1] + 1) * cells.size);
      [box[0], box[1]] = [Math.min(box[0], x), Math.min(box[1], y)];
      [box[2], box[3]] = [Math.max(box[2], x), Math.max(box[3], y)];
    }
    return box;
  }

  // From the frame of the cells to the map frame, m.
  inMap(cells, x, y) {
    const [ox, oy, theta] = cells.origin;
    return [ox + Math.cos(theta) * x - Math.sin(theta) * y, oy + Math.sin(theta) * x + Math.cos(theta) * y];
  }

  // From the map frame, m, to pixels of the canvas, and back.
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
    // From here on coordinates are m in the map frame, y upwards; `px` is the size of a pixel.
    const scale = this.scale * this.ratio;
    context.setTransform(scale, 0, 0, -scale, (this.width / 2) * this.ratio - this.centre[0] * scale, (this.height / 2) * this.ratio + this.centre[1] * scale);
    this.px = 1 / this.scale;
    context.lineJoin = context.lineCap = "round";
    this.drawMap();
    if (instant.cells) this.drawCells(instant.cells);
    if (this.shows("trail")) this.drawTrail();
    if (!instant.seen) {
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
    const { context, colours, px } = this;
    const [ox, oy, theta] = cells.origin;
    context.save();
    context.translate(ox, oy);
    context.rotate(theta);
    const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
    for (let n = 0; n < cells.walls.length; n += 3) {
      for (const axis of [0, 1]) {
        low[axis] = Math.min(low[axis], cells.walls[n + axis]);
        high[axis] = Math.max(high[axis], cells.walls[n + axis]);
      }
    }
    if (!this.map.bounds) {
      context.fillStyle = colours.free;
      context.fillRect((low[0] + 1) * cells.size, (low[1] + 1) * cells.size, (high[0] - low[0]) * cells.size, (high[1] - low[1]) * cells.size);
    }
    if (this.shows("cells") && cells.size * this.scale > 14) {
      context.beginPath();
      for (let x = low[0] + 1; x <= high[0] + 1; x++) context.rect(x * cells.size, (low[1] + 1) * cells.size, 0, (high[1] - low[1]) * cells.size);
      for (let y = low[1] + 1; y <= high[1] + 1; y++) context.rect((low[0] + 1) * cells.size, y * cells.size, (high[0] - low[0]) * cells.size, 0);
      context.strokeStyle = colours.grid;
      context.lineWidth = px;
      context.stroke();
    }
    if (!this.map.bounds) {
      context.beginPath();
      for (let n = 0; n < cells.walls.length; n += 3) {
        const [x, y, north] = [cells.walls[n] * cells.size, cells.walls[n + 1] * cells.size, cells.walls[n + 2]];
        if (north) context.rect(x, y + cells.size, cells.size, 0);
        else context.rect(x + cells.size, y, 0, cells.size);
      }
      context.strokeStyle = colours.wall;
      context.lineWidth = 0.08 * cells.size;
      context.stroke();
    }
    if (this.shows("warehouse")) {
      const inset = 0.03 * cells.size;
      for (let n = 0; n < cells.warehouse.length; n += 2) {
        context.beginPath();
        context.rect(cells.warehouse[n] * cells.size + inset, cells.warehouse[n + 1] * cells.size + inset, cells.size - 2 * inset, cells.size - 2 * inset);
        context.globalAlpha = 0.28;
        context.fillStyle = colours.warehouse;
        context.fill();
        context.globalAlpha = 1;
        context.strokeStyle = colours.warehouse;
        context.lineWidth = Math.max(0.02, 1.5 * px);
        context.stroke();
      }
    }
    context.restore();
  }

  drawTrail() {
    const { context, trace, instant, px } = this;
    const seen = trace.records.Seen;
    const first = instant.began?.task === "deliver" ? Math.max(0, trace.indexAt("Seen", instant.time - TRAIL_DURATION)) : 0;
    if (!instant.pose) return;
    context.beginPath();
    const stride = Math.max(1, Math.floor((instant.at - first) / 600));
    for (let at = first; at <= instant.at; at += stride) context.lineTo(seen[at].pose[0], seen[at].pose[1]);
    context.lineTo(instant.pose[0], instant.pose[1]);
    context.strokeStyle = this.colours.trail;
    context.globalAlpha = 0.6;
    context.lineWidth = Math.max(0.025, 1.5 * px);
    context.stroke();
    context.globalAlpha = 1;
  }

  drawLaser() {
    const { context, px, colours } = this;
    const { seen, lidar } = this.instant;
    const [x, y] = seen.pose;
    const { points } = seen;
    if (!points.length) return;
    context.beginPath();
    context.moveTo(seen.lidar[0], seen.lidar[1]);
    for (let n = 0; n < points.length; n += 2) {
      context.lineTo(seen.lidar[0], seen.lidar[1]);
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
    const { seen } = this.instant;
    if (seen.path.length <= 2) return;
    context.beginPath();
    for (let n = 0; n < seen.path.length; n += 2)
      context.lineTo(seen.pose[0] + seen.path[n] * POSITION_STEP, seen.pose[1] + seen.path[n + 1] * POSITION_STEP);
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
    this.disc(plan[plan.length - 2], plan[plan.length - 1], Math.max(0.07, 4 * px), colours.plan);
    context.globalAlpha = 1;
  }

  disc(x, y, radius, fill, edge) {
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

  // Positions [x, y] of the boxes on the floor, m.
  boxes() {
    const { seen } = this.instant;
    const positions = [];
    if (seen)
      for (let n = 0; n < seen.boxes.length; n += 2)
        positions.push([seen.pose[0] + seen.boxes[n] * POSITION_STEP, seen.pose[1] + seen.boxes[n + 1] * POSITION_STEP]);
    return positions;
  }

  drawBoxes() {
    const radius = Math.max(this.boxRadius, 4 * this.px);
    for (const [x, y] of this.boxes()) this.disc(x, y, radius, this.colours.box, this.colours["robot-edge"]);
  }

  // The robot from above: two prongs, the body with the lidar at the back, and the load between the prongs.
  drawRobot() {
    const { context, px, colours, instant } = this;
    const { pose, lidar, seen } = instant;
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
    if (seen.loaded) this.disc(x, y, radius * 0.5, colours.box, colours["robot-edge"]);
    const larger = radius / this.robotRadius;
    this.disc(x + (lidar[0] - x) * larger, y + (lidar[1] - y) * larger, radius * 0.17, colours.laser);
  }

  drawParticles() {
    const { context, px } = this;
    const { seen } = this.instant;
    const [x, y] = seen.pose;
    const { particles } = seen;
    if (!particles.length) return;
    const length = Math.max(0.1, 6 * px);
    context.beginPath();
    for (let n = 0; n < particles.length; n += 3) {
      const [px0, py0, theta] = [x + particles[n] * POSITION_STEP, y + particles[n + 1] * POSITION_STEP, particles[n + 2] * ANGLE_STEP];
      context.moveTo(px0, py0);
      context.lineTo(px0 + length * Math.cos(theta), py0 + length * Math.sin(theta));
    }
    context.strokeStyle = this.colours.particle;
    context.globalAlpha = 0.55;
    context.lineWidth = Math.max(0.008, px);
    context.stroke();
    context.globalAlpha = 1;
  }

  // Objects of a grid without a robot: a frame for destinations, a disc for the carrier, a smaller one for its load.
  drawObjects() {
    const { perceived, cells } = this.instant;
    if (!perceived || !cells) return;
    const objects = perceived.things.filter(({ values }) => values.x !== undefined);
    const order = ["place", "carrier", "load"];
    objects.sort((a, b) => order.indexOf(KINDS[a.kind]) - order.indexOf(KINDS[b.kind]));
    for (const object of objects) {
      const role = KINDS[object.kind] ?? "load";
      const [x, y] = this.inMap(cells, ...this.cellOf(object).map((at) => (at + 0.5) * cells.size));
      const fill = this.colours[KIND_COLOURS[role]];
      if (role === "place") this.frame(x, y, 0.42 * cells.size, fill);
      else this.disc(x, y, (role === "carrier" ? 0.3 : 0.17) * cells.size, fill, this.colours["robot-edge"]);
      const below = { carrier: -0.34, load: 0.28, place: 0.39 }[role];
      if (cells.size * this.scale >= LABEL_MIN_CELL) this.label(object.name, x, y - below * cells.size, role === "carrier" ? fill : this.colours.ink);
    }
    this.drawSelection();
  }

  // The cell of an object. A carried object is in the cell of its carrier; its own x and y stay those of the pickup.
  cellOf(object) {
    const carrier = isCarried(object) && this.instant.perceived.things.find(({ kind }) => KINDS[kind] === "carrier");
    const { x, y } = (carrier || object).values;
    return [x, y];
  }

  // A square around the centre of a cell, like those of the warehouse.
  frame(x, y, half, colour) {
    const { context, px } = this;
    context.beginPath();
    context.rect(x - half, y - half, 2 * half, 2 * half);
    context.globalAlpha = 0.28;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = colour;
    context.lineWidth = 2 * px;
    context.stroke();
  }

  // Text below a point of the map.
  label(text, x, y, fill) {
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
    const place = this.placeOf(this.selected);
    if (!place) return;
    const { context, px, colours } = this;
    context.beginPath();
    context.arc(place.x, place.y, Math.max(place.radius + 4 * px, 9 * px), 0, 2 * Math.PI);
    context.strokeStyle = colours.accent;
    context.lineWidth = 2.5 * px;
    context.stroke();
  }

  // The object at a pixel, as {kind, …}; null where the map is unknown.
  pick(px, py) {
    const { instant } = this;
    if (!instant) return null;
    const [x, y] = this.unproject(px, py);
    const tolerance = 6 / this.scale;
    const near = (ox, oy, radius) => Math.hypot(x - ox, y - oy) <= radius + tolerance;
    if (instant.pose && near(instant.pose[0], instant.pose[1], this.robotRadius)) return { kind: "robot" };
    const box = this.boxes().find(([bx, by]) => near(bx, by, this.boxRadius));
    if (box) return { kind: "box", name: this.nameOfBox(box), x: box[0], y: box[1] };
    if (instant.cells) {
      const [cx, cy] = this.cellAt(instant.cells, x, y);
      const object = !instant.seen && instant.perceived?.things.find((item) => this.cellOf(item).join() === `${cx},${cy}`);
      if (object) return { kind: "object", name: object.name };
      const { warehouse } = instant.cells;
      for (let n = 0; n < warehouse.length; n += 2)
        if (warehouse[n] === cx && warehouse[n + 1] === cy) return { kind: "warehouse", cell: [cx, cy] };
    }
    return this.map.percentAt(x, y) === null ? null : { kind: "place", x, y };
  }

  // All objects that can be selected, in the order of the O key.
  pickable() {
    const { instant } = this;
    const objects = instant?.pose ? [{ kind: "robot" }] : (instant?.perceived?.things ?? []).map(({ name }) => ({ kind: "object", name }));
    for (const box of this.boxes()) objects.push({ kind: "box", name: this.nameOfBox(box), x: box[0], y: box[1] });
    const warehouse = instant?.cells?.warehouse ?? [];
    for (let n = 0; n < warehouse.length; n += 2) objects.push({ kind: "warehouse", cell: [warehouse[n], warehouse[n + 1]] });
    return objects;
  }

  pickNext() {
    const objects = this.pickable();
    const key = (object) => JSON.stringify([object.kind, object.name, object.cell]);
    const here = this.selected ? objects.findIndex((object) => key(object) === key(this.selected)) : -1;
    this.selected = objects[(here + 1) % objects.length] ?? null;
  }

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
    return perceived.things.find((object) => object.kind === "Box" && object.values.x === cx && object.values.y === cy)?.name ?? null;
  }

  // Position of a selected object, m; null if it is gone.
  placeOf(picked) {
    const { instant } = this;
    const { cells, perceived, pose } = instant;
    if (picked.kind === "robot") return pose && { x: pose[0], y: pose[1], radius: this.robotRadius };
    if (picked.kind === "place") return { x: picked.x, y: picked.y, radius: 0 };
    if (picked.kind === "warehouse" && cells) {
      const [x, y] = this.inMap(cells, (picked.cell[0] + 0.5) * cells.size, (picked.cell[1] + 0.5) * cells.size);
      return { x, y, radius: cells.size / 2 };
    }
    if (picked.kind === "box") {
      const object = perceived?.things.find((item) => item.name === picked.name);
      if (object?.values.in_bot) return pose && { x: pose[0], y: pose[1], radius: this.boxRadius };
      const nearest = this.boxes().find((box) => (picked.name ? this.nameOfBox(box) === picked.name : Math.hypot(box[0] - picked.x, box[1] - picked.y) < 0.3));
      return nearest ? { x: nearest[0], y: nearest[1], radius: this.boxRadius } : null;
    }
    const object = perceived?.things.find((item) => item.name === picked.name);
    if (!object || !cells) return null;
    const [x, y] = this.inMap(cells, ...this.cellOf(object).map((at) => (at + 0.5) * cells.size));
    return { x, y, radius: cells.size / 3 };
  }
}

// The plan from the robot on: its first segment is cut at the robot, if the robot is on it.
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

// Index at which the current leg of a plan ends: the first cell after a move in which the robot stays, to pick up or drop.
function legEnd(plan) {
  let moved = false;
  for (let n = 2; n < plan.length; n += 2) {
    const stays = plan[n] === plan[n - 2] && plan[n + 1] === plan[n - 1];
    if (stays && moved) return n - 2;
    moved ||= !stays;
  }
  return plan.length - 2;
}

// A pose interpolated between two records, for smooth playback.
function interpolated(pose, time, next, name, now) {
  if (!next || next.time - time > 3 || now <= time) return pose;
  const fraction = Math.min((now - time) / (next.time - time), 1);
  const [x, y, theta] = next[name];
  const turn = Math.atan2(Math.sin(theta - pose[2]), Math.cos(theta - pose[2]));
  return [pose[0] + (x - pose[0]) * fraction, pose[1] + (y - pose[1]) * fraction, pose[2] + turn * fraction];
}

function rgb(colour) {
  const digits = colour.slice(1);
  const wide = digits.length < 6 ? [...digits].map((digit) => digit + digit).join("") : digits;
  return [0, 2, 4].map((at) => parseInt(wide.slice(at, at + 2), 16));
}
