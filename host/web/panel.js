// The panel to scale: an SVG over the map whose units are mm, and the ways between page, screen and surface.

// A bar is drawn at least this high, as a part of its length, or a finger could not hit it.
const LEAST_HEIGHT = 0.16;
// Radius around a target within which the contrast counts, in mm (TARGET_RADIUS_M of the planner).
const TARGET_RADIUS_MM = 10;

function element(name, attributes, text) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

export class PanelView {
  constructor(panel, heat, overlay) {
    Object.assign(this, { panel, heat, overlay, scene: null, touches: [], plan: null, cursor: null });
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
    this.panel.style.setProperty("--aspect", length_mm / this.height_mm);
    this.heat.setSize(length_mm, width_mm, this.height_mm);
    this.draw();
  }

  // The same surface with attachments elsewhere.
  setAttachments(scene) {
    this.scene = scene;
    this.draw();
  }

  setPlan(plan, touches) {
    Object.assign(this, { plan, touches });
    this.draw();
  }

  setAllInactive() {
    for (const actuator of this.active.keys()) this.setActive(actuator, false);
  }

  setActive(actuator, active) {
    if (this.active.get(actuator) === active) return;
    this.active.set(actuator, active);
    this.draw();
  }

  // Surface mm of a pointer event; y back from the stretched height of a bar.
  toSurface(event) {
    if (!this.scene) return null;
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

  // A place in mm with the predicted value there, in words.
  describe({ x_mm, y_mm }) {
    if (!this.scene) return "";
    const value = this.heat.value(x_mm, y_mm);
    const place = `${x_mm.toFixed(0)}, ${y_mm.toFixed(0)} mm`;
    return value === null ? place : `${place}: ${value.toFixed(3)} g`;
  }

  // The keyboard's cursor in mm of the surface.
  cursorPlace() {
    const [x_mm, y] = this.fromScreen(this.cursor);
    return { x_mm, y_mm: y / this.stretch };
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

  fromScreen({ x_px, y_px }) {
    const { screen } = this.scene;
    return [
      screen.x_mm + (x_px / screen.width_px) * screen.width_mm,
      (screen.y_mm + (y_px / screen.height_px) * screen.height_mm) * this.stretch,
    ];
  }

  draw() {
    if (!this.scene) return;
    const { length_mm: w, screen, patches, cutouts, supports, edges, masses, actuators } = this.scene;
    const h = this.height_mm;
    const unit = w / 300; // about 3 px on a wide screen
    const parts = [];
    const round = unit * 1.2;
    // An actuator at an edge is larger than what it covers of the surface.
    const surface = element("clipPath", { id: "on-surface" });
    surface.append(element("rect", { width: w, height: h }));
    parts.push(surface);
    parts.push(element("rect", { class: "surface", width: w, height: h, rx: round, "stroke-width": unit * 0.5 }));
    if (screen.width_mm < w * 0.999 || screen.height_mm * this.stretch < h * 0.999) {
      parts.push(element("rect", {
        class: "screen", x: screen.x_mm, y: screen.y_mm * this.stretch, width: screen.width_mm,
        height: screen.height_mm * this.stretch, "stroke-width": unit * 0.7,
      }));
    }
    for (const [name, rectangles] of [["patch", patches], ["cutout", cutouts]]) {
      for (const { x_mm: x, y_mm, length_mm: width, width_mm } of rectangles) {
        parts.push(element("rect", {
          class: name, x, y: y_mm * this.stretch, width, height: width_mm * this.stretch, "stroke-width": unit * 0.5,
        }));
      }
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
      if (this.stretch === 1) {
        parts.push(element("circle", { class: "near", cx: x, cy: y, r: TARGET_RADIUS_MM, "stroke-width": unit * 0.6 }));
      }
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
    const drive = this.plan?.drives.find((candidate) => candidate.actuator === actuator.id);
    const outline = element("g", { "clip-path": "url(#on-surface)" });
    outline.append(circle("actuator-shade", 2.2 * unit), circle("actuator", 1.1 * unit));
    parts.push(outline);
    if (drive && this.active.get(actuator.id)) {
      // The stronger the force (it goes with the voltage squared), the further and thicker the rings; 200 times slower
      // than the vibration, so that 200 Hz is one ring a second.
      const strength = Math.min((drive.voltage_v / actuator.max_voltage_v) ** 2, 1);
      const period = 200 / drive.frequency_hz;
      for (const part of [0, 0.5]) {
        const ring = circle("ring", unit * (0.6 + 1.4 * strength));
        ring.style.transformOrigin = `${cx}px ${cy}px`;
        ring.style.setProperty("--reach", 1.2 + 1.1 * strength);
        ring.style.animationDuration = `${2 * period}s`;
        // Against the page's own clock, or every new plan would start the rings again.
        ring.style.animationDelay = `${-((performance.now() / 1000) % (2 * period)) - part * 2 * period}s`;
        outline.append(ring);
      }
    }
    const size = Math.min(4.6 * unit + 2, h / 6);
    const text = (dy, content) => element("text", { x: cx, y: cy + dy, "font-size": size }, content);
    parts.push(text(drive ? -size * 0.25 : size * 0.35, actuator.id));
    if (drive) parts.push(text(size, `${drive.frequency_hz.toFixed(0)} Hz`));
  }
}
