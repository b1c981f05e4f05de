// The panel to scale: heat map on a canvas, everything else in an SVG over it whose units are mm.

// Viridis (van der Walt and Smith, CC0) at nine equal steps: even to the eye, safe for colour-blind people.
const VIRIDIS = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37]];

function color(part) {
  const at = Math.min(Math.max(part, 0), 1) * (VIRIDIS.length - 1);
  const i = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[i].map((from, k) => Math.round(from + (at - i) * (VIRIDIS[i + 1][k] - from)));
}

export function drawScale(canvas) {
  const context = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x++) {
    context.fillStyle = `rgb(${color(x / (canvas.width - 1)).join(" ")})`;
    context.fillRect(x, 0, 1, 1);
  }
}

// A bar is drawn at least this high, as a part of its length, or a finger could not hit it.
const LEAST_HEIGHT = 0.16;
const MAP_WIDTH = 480;

function element(name, attributes, text) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

export class PanelView {
  constructor(panel, heat, overlay) {
    Object.assign(this, { panel, heat, overlay, scene: null, field: null, touches: [], plan: null, cursor: null });
    this.active = new Map();
  }

  setScene(scene) {
    this.scene = scene;
    const { length_mm, width_mm, screen } = scene;
    this.height_mm = Math.max(width_mm, LEAST_HEIGHT * length_mm);
    this.stretch = this.height_mm / width_mm; // 1 except for bars
    this.panel.style.aspectRatio = `${length_mm} / ${this.height_mm}`;
    this.overlay.setAttribute("viewBox", `0 0 ${length_mm} ${this.height_mm}`);
    this.cursor ??= { x_px: screen.width_px / 2, y_px: screen.height_px / 2 };
    this.heat.width = MAP_WIDTH;
    this.heat.height = Math.round((MAP_WIDTH * this.height_mm) / length_mm);
    this.draw();
    this.drawField();
  }

  setPlan(plan) {
    this.plan = plan;
    this.draw();
  }

  setTouches(touches) {
    this.touches = touches;
    this.draw();
  }

  setActive(actuator, active) {
    if (this.active.get(actuator) === active) return;
    this.active.set(actuator, active);
    this.draw();
  }

  setField(field) {
    this.field = field;
    this.heat.dataset.maxG = field.max_g;
    this.heat.dataset.planId = field.plan_id;
    this.drawField();
  }

  clearField() {
    this.field = null;
    this.heat.dataset.maxG = 0;
    this.heat.dataset.planId = 0;
    this.heat.getContext("2d").clearRect(0, 0, this.heat.width, this.heat.height);
  }

  // Surface mm of a pointer event; y back from the stretched height of a bar.
  toSurface(event) {
    const box = this.panel.getBoundingClientRect();
    return {
      x_mm: ((event.clientX - box.left) / box.width) * this.scene.length_mm,
      y_mm: ((event.clientY - box.top) / box.height) * this.scene.width_mm,
    };
  }

  // Screen px of a pointer event; null beside the screen.
  toScreen(event) {
    if (!this.scene) return null;
    const { screen } = this.scene;
    const { x_mm, y_mm } = this.toSurface(event);
    const u = (x_mm - screen.x_mm) / screen.width_mm;
    const v = (y_mm - screen.y_mm) / screen.height_mm;
    if (u < 0 || u > 1 || v < 0 || v > 1) return null;
    return { x_px: u * screen.width_px, y_px: v * screen.height_px };
  }

  describe(event) {
    if (!this.scene) return "";
    const { x_mm, y_mm } = this.toSurface(event);
    const place = `${x_mm.toFixed(0)}, ${y_mm.toFixed(0)} mm`;
    return this.field ? `${place}: ${this.value(x_mm, y_mm).toFixed(3)} g` : place;
  }

  moveCursor(dx, dy, part) {
    if (!this.scene) return;
    const { width_px, height_px } = this.scene.screen;
    const within = (value, most) => Math.min(Math.max(value, 0), most);
    this.cursor = {
      x_px: within(this.cursor.x_px + dx * part * width_px, width_px),
      y_px: within(this.cursor.y_px + dy * part * height_px, height_px),
    };
    this.cursorShown = true;
    this.draw();
  }

  showCursor(shown) {
    this.cursorShown = shown;
    this.draw();
  }

  // Field in g, bilinear between grid points.
  value(x_mm, y_mm) {
    const { nx, ny, x_mm: xs, y_mm: ys, peak_g } = this.field;
    const place = (lines, at) => {
      if (lines.length < 2) return [0, 0];
      const p = Math.min(Math.max(((at - lines[0]) / (lines.at(-1) - lines[0])) * (lines.length - 1), 0), lines.length - 1);
      const cell = Math.min(Math.floor(p), lines.length - 2);
      return [cell, p - cell];
    };
    const [i, u] = place(xs, x_mm);
    const [j, v] = place(ys, y_mm);
    const at = (a, b) => peak_g[Math.min(b, ny - 1) * nx + Math.min(a, nx - 1)];
    return (at(i, j) * (1 - u) + at(i + 1, j) * u) * (1 - v) + (at(i, j + 1) * (1 - u) + at(i + 1, j + 1) * u) * v;
  }

  drawField() {
    if (!this.scene || !this.field || !(this.field.max_g > 0)) return;
    const { width, height } = this.heat;
    const context = this.heat.getContext("2d");
    const image = context.createImageData(width, height);
    for (let py = 0, at = 0; py < height; py++) {
      const y = ((py + 0.5) / height) * this.scene.width_mm;
      for (let px = 0; px < width; px++, at += 4) {
        const x = ((px + 0.5) / width) * this.scene.length_mm;
        const [r, g, b] = color(this.value(x, y) / this.field.max_g);
        image.data[at] = r;
        image.data[at + 1] = g;
        image.data[at + 2] = b;
        image.data[at + 3] = 255;
      }
    }
    context.putImageData(image, 0, 0);
  }

  fromScreen({ x_px, y_px }) {
    const { screen } = this.scene;
    return [
      screen.x_mm + (x_px / screen.width_px) * screen.width_mm,
      (screen.y_mm + (y_px / screen.height_px) * screen.height_mm) * this.stretch,
    ];
  }

  draw() {
    if (!this.scene) return;
    const { length_mm: w, screen, supports, edges, masses, actuators } = this.scene;
    const h = this.height_mm;
    const unit = w / 300; // about 3 px on a wide screen
    const parts = [];
    if (screen.width_mm < w * 0.999 || screen.height_mm * this.stretch < h * 0.999) {
      parts.push(element("rect", {
        class: "screen", x: screen.x_mm, y: screen.y_mm * this.stretch, width: screen.width_mm,
        height: screen.height_mm * this.stretch, "stroke-width": unit * 0.7,
      }));
    }
    const sides = { left: [0, 0, 0, h], right: [w, 0, w, h], top: [0, 0, w, 0], bottom: [0, h, w, h] };
    for (const { side, kind } of edges) {
      const [x1, y1, x2, y2] = sides[side];
      parts.push(element("line", { class: `edge ${kind}`, x1, y1, x2, y2, "stroke-width": kind === "clamped" ? 3 * unit : 1.6 * unit }));
    }
    for (const { x_mm, y_mm } of supports) {
      const [x, y, s] = [x_mm, y_mm * this.stretch, 3 * unit];
      parts.push(element("path", { class: "support", d: `M${x} ${y - s}L${x + s} ${y + s}H${x - s}Z`, "stroke-width": unit * 0.8 }));
    }
    for (const { x_mm, y_mm } of masses) {
      parts.push(element("circle", { class: "mass", cx: x_mm, cy: y_mm * this.stretch, r: 2 * unit }));
    }
    for (const actuator of actuators) this.drawActuator(parts, actuator, unit, h);
    for (const touch of this.touches) {
      const [x, y] = this.fromScreen(touch);
      const s = 5 * unit;
      const d = `M${x - s} ${y}H${x + s}M${x} ${y - s}V${y + s}`;
      parts.push(element("path", { class: "target-shade", d, "stroke-width": 2.2 * unit }));
      parts.push(element("path", { class: "target", d, "stroke-width": unit }));
    }
    if (this.cursorShown && this.cursor) {
      const [cx, cy] = this.fromScreen(this.cursor);
      parts.push(element("circle", { class: "cursor", cx, cy, r: 5 * unit, "stroke-width": 1.5 * unit }));
    }
    this.overlay.replaceChildren(...parts);
  }

  drawActuator(parts, actuator, unit, h) {
    const [cx, cy] = [actuator.x_mm, actuator.y_mm * this.stretch];
    const r = Math.min(actuator.electrode_diameter_mm / 2, h * 0.42);
    const circle = (name, width) => element("circle", { class: name, cx, cy, r, "stroke-width": width });
    const ring = circle(`ring ${this.active.get(actuator.id) ? "on" : ""}`, unit);
    ring.style.transformOrigin = `${cx}px ${cy}px`;
    parts.push(circle("actuator-shade", 2.2 * unit), circle("actuator", 1.1 * unit), ring);
    const drive = this.plan?.drives.find((candidate) => candidate.actuator === actuator.id);
    const size = Math.min(7 * unit + 2, h / 6);
    const text = (dy, content) => element("text", { x: cx, y: cy + dy, "font-size": size }, content);
    parts.push(text(drive ? -size * 0.25 : size * 0.35, actuator.id));
    if (drive) parts.push(text(size, `${drive.frequency_hz.toFixed(0)} Hz`));
  }
}
