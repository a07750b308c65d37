"use strict";
// The map at any time of a trace, as an image in which only changed tiles are painted again.

const TILE = 64; // side of a tile, grid cells
const UNKNOWN = 255; // value of unknown cells; known ones have P(occupied) in percent

class MapPicture {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.palette = new Uint32Array(256);
    this.knownBounds = new WeakMap(); // bounds of the known cells of a tile, by its pixels
    this.clear();
  }

  clear() {
    this.shownIndex = -1; // of the painted MapUpdate
    this.anchorNumber = 0;
    this.bounds = null; // tiles, as [x0, y0, x1, y1] with exclusive ends
    this.tiles = new Map(); // pixels of each tile by its key "x,y"
  }

  // Set the colours of free, occupied and unknown cells, as [r, g, b].
  setColours(free, wall, unknown) {
    for (let percent = 0; percent <= 100; percent++) {
      const fraction = percent / 100;
      const [r, g, b] = free.map((from, channel) => Math.round(from + (wall[channel] - from) * fraction));
      this.palette[percent] = (255 << 24) | (b << 16) | (g << 8) | r;
    }
    this.palette[UNKNOWN] = (255 << 24) | (unknown[2] << 16) | (unknown[1] << 8) | unknown[0];
    this.repaint();
  }

  // Show the map of an update, given its index; return whether anything changed.
  show(updates, index) {
    if (index === this.shownIndex) return false;
    if (index < 0) {
      this.clear();
      return true;
    }
    const update = updates[index];
    let first = this.shownIndex + 1;
    if (index < this.shownIndex || update.map !== this.anchorNumber) {
      this.clear();
      first = index;
      while (first > 0 && updates[first - 1].map === update.map) first--;
    }
    this.shownIndex = index;
    this.anchorNumber = update.map;
    this.origin = update.origin;
    this.resolution = update.resolution;
    const changed = new Map();
    for (const { tiles, pixels } of updates.slice(first, index + 1))
      for (let n = 0; n < tiles.length / 2; n++)
        changed.set(`${tiles[2 * n]},${tiles[2 * n + 1]}`, pixels.subarray(n * TILE * TILE, (n + 1) * TILE * TILE));
    for (const [key, pixels] of changed) this.tiles.set(key, pixels);
    if (this.grow(changed.keys())) this.repaint();
    else for (const [key, pixels] of changed) this.paintTile(key, pixels);
    return true;
  }

  // Enlarge the image to contain tiles; return whether it was enlarged, which clears it.
  grow(keys) {
    let [x0, y0, x1, y1] = this.bounds ?? [Infinity, Infinity, -Infinity, -Infinity];
    for (const key of keys) {
      const [x, y] = key.split(",").map(Number);
      [x0, y0, x1, y1] = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x + 1), Math.max(y1, y + 1)];
    }
    if (x1 < x0 || (this.bounds && [x0, y0, x1, y1].every((bound, index) => bound === this.bounds[index]))) return false;
    this.bounds = [x0, y0, x1, y1];
    this.canvas.width = (x1 - x0) * TILE;
    this.canvas.height = (y1 - y0) * TILE;
    return true;
  }

  repaint() {
    if (!this.bounds) return;
    this.context = this.canvas.getContext("2d");
    this.context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    for (const [key, pixels] of this.tiles) this.paintTile(key, pixels);
  }

  // Row 0 of a tile is at its smallest y, so the scene draws the image mirrored.
  paintTile(key, pixels) {
    const [x, y] = key.split(",").map(Number);
    const image = new ImageData(TILE, TILE);
    const colours = new Uint32Array(image.data.buffer);
    for (let index = 0; index < pixels.length; index++) colours[index] = this.palette[pixels[index]];
    this.context.putImageData(image, (x - this.bounds[0]) * TILE, (y - this.bounds[1]) * TILE);
  }

  // Bounds of the known cells, m, map frame, as [west, south, east, north]; null if there are none.
  extent() {
    if (!this.bounds) return null;
    const [ox, oy, theta] = this.origin;
    const side = TILE * this.resolution;
    let box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [key, pixels] of this.tiles) {
      if (!this.knownBounds.has(pixels)) this.knownBounds.set(pixels, boundsOfKnown(pixels));
      const bounds = this.knownBounds.get(pixels);
      if (!bounds) continue;
      const [x, y] = key.split(",").map(Number);
      for (const [u, v] of [[0, 1], [2, 1], [0, 3], [2, 3]]) {
        const px = (x + bounds[u] / TILE) * side;
        const py = (y + bounds[v] / TILE) * side;
        const mx = ox + Math.cos(theta) * px - Math.sin(theta) * py;
        const my = oy + Math.sin(theta) * px + Math.cos(theta) * py;
        box = [Math.min(box[0], mx), Math.min(box[1], my), Math.max(box[2], mx), Math.max(box[3], my)];
      }
    }
    return box[0] < box[2] ? box : null;
  }

  // P(occupied) in percent at a point of the map frame; null if unknown.
  percentAt(x, y) {
    if (!this.bounds) return null;
    const [ox, oy, theta] = this.origin;
    const [dx, dy] = [x - ox, y - oy];
    const column = Math.floor((Math.cos(theta) * dx + Math.sin(theta) * dy) / this.resolution);
    const row = Math.floor((Math.cos(theta) * dy - Math.sin(theta) * dx) / this.resolution);
    const pixels = this.tiles.get(`${Math.floor(column / TILE)},${Math.floor(row / TILE)}`);
    const percent = pixels?.[(row - Math.floor(row / TILE) * TILE) * TILE + (column - Math.floor(column / TILE) * TILE)];
    return percent === undefined || percent === UNKNOWN ? null : percent;
  }
}

// Bounds of the known cells of a tile, as [x0, y0, x1, y1] with exclusive ends; null if there are none.
function boundsOfKnown(pixels) {
  let [x0, y0, x1, y1] = [TILE, TILE, 0, 0];
  for (let index = 0; index < pixels.length; index++) {
    if (pixels[index] === UNKNOWN) continue;
    const [x, y] = [index % TILE, Math.floor(index / TILE)];
    if (x < x0) x0 = x;
    if (x >= x1) x1 = x + 1;
    if (y < y0) y0 = y;
    if (y >= y1) y1 = y + 1;
  }
  return x1 > x0 ? [x0, y0, x1, y1] : null;
}
