// The map of predicted acceleration: colours, drawing, values, legend.

// Viridis (van der Walt and Smith, CC0) at ten equal steps: even to the eye, safe for colour-blind people.
const VIRIDIS = ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"];
const SHADES = 256;
// Smooth once the browser scales it up, and little enough for 30 maps a second on a phone.
const RASTER_WIDTH = 320;

const TABLE = (() => {
  const anchors = VIRIDIS.map((hex) => [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16)));
  const table = new Uint8ClampedArray(SHADES * 4);
  for (let shade = 0; shade < SHADES; shade += 1) {
    const at = (shade / (SHADES - 1)) * (anchors.length - 1);
    const low = Math.min(Math.floor(at), anchors.length - 2);
    for (let c = 0; c < 3; c += 1) {
      table[shade * 4 + c] = Math.round(anchors[low][c] + (at - low) * (anchors[low + 1][c] - anchors[low][c]));
    }
    table[shade * 4 + 3] = 255;
  }
  return table;
})();

// The next pleasant number at or above a value, so that the legend can be read.
function roundUp(value) {
  if (!(value > 0)) return 1;
  const decade = 10 ** Math.floor(Math.log10(value));
  return decade * ([1, 1.2, 1.6, 2, 2.4, 3, 4, 5, 6, 8].find((step) => step * decade >= value) ?? 10);
}

// The grid cell of a place, and how far it is in it (0 to 1); beyond the grid, the nearest place in it.
function locate(lines, at) {
  let cell = 0;
  while (cell < lines.length - 2 && lines[cell + 1] < at) cell += 1;
  const width = (lines[cell + 1] ?? lines[cell]) - lines[cell];
  return [cell, width > 0 ? Math.min(Math.max((at - lines[cell]) / width, 0), 1) : 0];
}

// As `locate`, for the middles of `count` equal pixels over a length.
const locateAll = (lines, length, count) =>
  Array.from({ length: count }, (_, i) => locate(lines, ((i + 0.5) / count) * length));

// The values with those of cut-outs (null) made up from their neighbours', so that the map goes on to a hole's border.
function filled({ nx, ny, peak_g }) {
  if (!peak_g.includes(null)) return peak_g;
  return peak_g.map((value, at) => {
    if (value !== null) return value;
    const [i, j] = [at % nx, Math.floor(at / nx)];
    const near = [];
    for (let b = Math.max(j - 1, 0); b <= Math.min(j + 1, ny - 1); b += 1) {
      for (let a = Math.max(i - 1, 0); a <= Math.min(i + 1, nx - 1); a += 1) {
        if (peak_g[b * nx + a] !== null) near.push(peak_g[b * nx + a]);
      }
    }
    return near.length > 0 ? near.reduce((sum, value_g) => sum + value_g) / near.length : 0;
  });
}

export class Heat {
  constructor(canvas, scale, ticks) {
    Object.assign(this, { canvas, ticks, field: null, size: null, fixed_g: null, top_g: 1 });
    scale.width = SHADES;
    scale.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(TABLE), SHADES, 1), 0, 0);
    this.drawTicks();
  }

  // Size of the surface in mm, and the height at which it is drawn.
  setSize(length_mm, width_mm, height_mm) {
    this.size = [length_mm, width_mm];
    this.canvas.width = RASTER_WIDTH;
    this.canvas.height = Math.max(2, Math.round((RASTER_WIDTH * height_mm) / length_mm));
    this.draw();
  }

  // Upper end of the scale in g; null for one that follows the map.
  setScale(top_g) {
    this.fixed_g = top_g;
    this.draw();
  }

  // A field as the daemon sends it, or null.
  setField(field) {
    this.field = field?.max_g > 0 ? field : null;
    this.canvas.dataset.maxG = field?.max_g ?? 0;
    this.canvas.dataset.planId = field?.plan_id ?? 0;
    this.draw();
  }

  draw() {
    const { field, canvas } = this;
    this.top_g = this.fixed_g ?? roundUp(field?.max_g);
    this.drawTicks();
    const context = canvas.getContext("2d");
    const { width, height } = canvas;
    if (!field || !this.size) {
      context.clearRect(0, 0, width, height);
      return;
    }
    const image = context.createImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    const colors = new Uint32Array(TABLE.buffer);
    const across = locateAll(field.x_mm, this.size[0], width);
    const down = locateAll(field.y_mm, this.size[1], height);
    const { nx, ny } = field;
    const peak_g = filled(field);
    const [right, below] = [nx > 1 ? 1 : 0, ny > 1 ? nx : 0];
    const factor = (SHADES - 1) / this.top_g;
    let out = 0;
    for (const [j, v] of down) {
      for (const [i, u] of across) {
        const at = j * nx + i;
        const upper = peak_g[at] + u * (peak_g[at + right] - peak_g[at]);
        const lower = peak_g[at + below] + u * (peak_g[at + below + right] - peak_g[at + below]);
        pixels[out] = colors[Math.min(Math.round((upper + v * (lower - upper)) * factor), SHADES - 1)];
        out += 1;
      }
    }
    context.putImageData(image, 0, 0);
  }

  // Predicted peak in g at a point of the surface; null without a map.
  value(x_mm, y_mm) {
    if (!this.field) return null;
    const { nx, ny, x_mm: xs, y_mm: ys, peak_g } = this.field;
    const [[i, u], [j, v]] = [locate(xs, x_mm), locate(ys, y_mm)];
    if (peak_g[Math.round(j + v) * nx + Math.round(i + u)] === null) return null;
    const values = filled(this.field);
    const at = (a, b) => values[Math.min(b, ny - 1) * nx + Math.min(a, nx - 1)];
    return (at(i, j) * (1 - u) + at(i + 1, j) * u) * (1 - v) + (at(i, j + 1) * (1 - u) + at(i + 1, j + 1) * u) * v;
  }

  drawTicks() {
    const texts = [0, 0.25, 0.5, 0.75, 1].map((part) => `${Number((part * this.top_g).toPrecision(3))}`);
    texts[4] += " g";
    this.ticks.replaceChildren(...texts.map((textContent) => Object.assign(document.createElement("span"), { textContent })));
  }
}
