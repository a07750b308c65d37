"use strict";
// The map at any time of a trace, kept as one picture of which only what changed is painted anew.

const TILE = 64; // grid cells
const UNKNOWN = 255; // percent that mean: not known

class MapPicture {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.palette = new Uint32Array(256);
    this.knownParts = new WeakMap(); // pixels of a tile → the part of it that is known
    this.forget();
  }

  forget() {
    this.shown = -1; // index of the Explored record that is painted
    this.number = 0;
    this.bounds = null; // first and one-past-last tile: x0, y0, x1, y1
    this.tiles = new Map(); // "x,y" → pixels
  }

  // Colours, as [r, g, b], of free, occupied and unknown cells.
  paint(free, wall, unknown) {
    for (let percent = 0; percent <= 100; percent++) {
      const share = percent / 100;
      const [r, g, b] = free.map((from, at) => Math.round(from + (wall[at] - from) * share));
      this.palette[percent] = (255 << 24) | (b << 16) | (g << 8) | r;
    }
    this.palette[UNKNOWN] = (255 << 24) | (unknown[2] << 16) | (unknown[1] << 8) | unknown[0];
    this.repaint();
  }

  // Show the map of the record with an index; return whether anything changed.
  show(explored, index) {
    if (index === this.shown) return false;
    if (index < 0) {
      this.forget();
      return true;
    }
    const record = explored[index];
    let first = this.shown + 1;
    if (index < this.shown || record.map !== this.number) {
      this.forget();
      first = index;
      while (first > 0 && explored[first - 1].map === record.map) first--;
    }
    this.shown = index;
    this.number = record.map;
    this.origin = record.origin;
    this.resolution = record.resolution;
    const fresh = new Map();
    for (let at = first; at <= index; at++) {
      const { tiles, pixels } = explored[at];
      for (let n = 0; n < tiles.length / 2; n++)
        fresh.set(`${tiles[2 * n]},${tiles[2 * n + 1]}`, pixels.subarray(n * TILE * TILE, (n + 1) * TILE * TILE));
    }
    for (const [key, pixels] of fresh) this.tiles.set(key, pixels);
    if (this.grow(fresh.keys())) this.repaint();
    else for (const [key, pixels] of fresh) this.paintTile(key, pixels);
    return true;
  }

  // Make room for tiles; return whether the picture had to be made anew.
  grow(keys) {
    let [x0, y0, x1, y1] = this.bounds ?? [Infinity, Infinity, -Infinity, -Infinity];
    for (const key of keys) {
      const [x, y] = key.split(",").map(Number);
      [x0, y0, x1, y1] = [Math.min(x0, x), Math.min(y0, y), Math.max(x1, x + 1), Math.max(y1, y + 1)];
    }
    if (x1 < x0 || (this.bounds && [x0, y0, x1, y1].every((side, at) => side === this.bounds[at]))) return false;
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

  // Row 0 of a tile is its smallest y, and the picture is drawn mirrored.
  paintTile(key, pixels) {
    const [x, y] = key.split(",").map(Number);
    const image = new ImageData(TILE, TILE);
    const colours = new Uint32Array(image.data.buffer);
    for (let at = 0; at < pixels.length; at++) colours[at] = this.palette[pixels[at]];
    this.context.putImageData(image, (x - this.bounds[0]) * TILE, (y - this.bounds[1]) * TILE);
  }

  // Corners of what is known, m, map frame: west, south, east, north; null while nothing is.
  extent() {
    if (!this.bounds) return null;
    const [ox, oy, theta] = this.origin;
    const side = TILE * this.resolution;
    let box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [key, pixels] of this.tiles) {
      const known = this.knownParts;
      if (!known.has(pixels)) known.set(pixels, knownPart(pixels));
      const part = known.get(pixels);
      if (!part) continue;
      const [x, y] = key.split(",").map(Number);
      for (const [u, v] of [[0, 1], [2, 1], [0, 3], [2, 3]]) {
        const px = (x + part[u] / TILE) * side;
        const py = (y + part[v] / TILE) * side;
        const mx = ox + Math.cos(theta) * px - Math.sin(theta) * py;
        const my = oy + Math.sin(theta) * px + Math.cos(theta) * py;
        box = [Math.min(box[0], mx), Math.min(box[1], my), Math.max(box[2], mx), Math.max(box[3], my)];
      }
    }
    return box[0] < box[2] ? box : null;
  }

  // P(occupied) in percent at a point of the map frame; null where nothing is known.
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

// First and one-past-last column and row of a tile that are known: x0, y0, x1, y1; null if none is.
function knownPart(pixels) {
  let [x0, y0, x1, y1] = [TILE, TILE, 0, 0];
  for (let at = 0; at < pixels.length; at++) {
    if (pixels[at] === UNKNOWN) continue;
    const [x, y] = [at % TILE, (at / TILE) | 0];
    if (x < x0) x0 = x;
    if (x >= x1) x1 = x + 1;
    if (y < y0) y0 = y;
    if (y >= y1) y1 = y + 1;
  }
  return x1 > x0 ? [x0, y0, x1, y1] : null;
}
