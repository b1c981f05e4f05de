// Design mode: supports, masses and actuators are dragged, the daemon previews what a touch would then do, and nothing is
// driven. The scene of the daemon stays; what was moved is kept here and goes with every question, as does another scene that was opened.
import { sleep } from "./job.js";
import { COMPUTATION_ANSWER_MS, request } from "./link.js";

// As in a scene file, and as the daemon's JSON calls the lists.
const LISTS = { support: "supports", mass: "masses", actuator: "actuators" };
// Before asking again where another page's question was newer; the daemon computes one at a time.
const AGAIN_MS = 150;

// Key steps in mm: a power of ten, between a hundredth and a thousandth of the surface's length.
const stepFor = (length_mm) => 10 ** Math.floor(Math.log10(length_mm / 100));

export class Design {
  // view: the PanelView; layer: the element for the handles; intensity(): the peak wanted in g; handlers: preview(answer,
  // question), failed(problem), pending(), placed(words), opened(scene).
  constructor(view, layer, intensity, handlers) {
    Object.assign(this, { view, layer, intensity, handlers, on: false, scene: null, touch: null, answer: null });
    this.own = null; // the daemon's scene
    this.text = null; // the file of another one that is previewed in its stead
    this.shown = null; // the file of the scene that is shown
    this.moves = new Map(); // name in a scene's messages -> {x_mm, y_mm?}
    this.handles = new Map(); // the same name -> button
    this.wanted = 0; // counts questions
    this.answered = 0; // the last one that is answered
    this.asking = false;
  }

  // The daemon's scene. Moves are kept over a lost link, unless another scene comes back.
  setScene(scene) {
    if (JSON.stringify(scene) !== JSON.stringify(this.own)) {
      this.moves.clear();
      this.touch = null;
      Object.assign(this, { own: scene, scene, text: null, shown: null });
    }
    if (this.on) this.start(this.touch);
  }

  // Begins with a touch in screen px; without one, at the last place or the middle of the screen.
  start(touch) {
    this.on = true;
    const { width_px, height_px } = this.scene.screen;
    const { x_px, y_px } = touch ?? this.touch ?? { x_px: width_px / 2, y_px: height_px / 2 };
    this.touch = { x_px, y_px };
    this.makeHandles();
    this.show();
  }

  end() {
    this.on = false;
    this.answer = null;
    this.layer.replaceChildren();
    this.handles.clear();
    this.become(null, this.own);
    this.view.setAttachments(this.scene);
  }

  reset() {
    this.moves.clear();
    if (this.become(null, this.own)) this.makeHandles();
    this.show();
  }

  // Previews another scene, by its file's text; it is shown as soon as the daemon has read it.
  open(text) {
    this.text = text;
    this.ask();
  }

  // The scene with this file (the daemon's: null) is the one to be changed from here on; whether it is another one than before.
  become(text, scene) {
    const isOther = text !== this.shown || scene !== this.scene;
    Object.assign(this, { text, shown: text, scene });
    if (!isOther) return false;
    this.moves.clear();
    this.handlers.opened(scene);
    return true;
  }

  setTouch(touch) {
    this.touch = touch;
    this.ask();
  }

  // The daemon's scene with what was moved.
  moved() {
    const scene = { ...this.scene };
    for (const [table, list] of Object.entries(LISTS)) {
      scene[list] = scene[list].map((entry, i) => ({ ...entry, ...this.moves.get(`${table}[${i + 1}]`) }));
    }
    return scene;
  }

  // Draws what was moved and asks what it does.
  show() {
    this.view.setAttachments(this.moved());
    for (const name of this.handles.keys()) this.placeHandle(name);
    this.ask();
  }

  // The preview of the newest state; while one is computed, moves gather.
  async ask() {
    this.wanted += 1;
    this.handlers.pending();
    if (this.asking) return;
    this.asking = true;
    while (this.on && this.answered !== this.wanted) {
      const [now, text] = [this.wanted, this.text];
      const isNew = text !== this.shown;
      try {
        const body = { ...this.touch, intensity_g: this.intensity(), moves: isNew ? {} : Object.fromEntries(this.moves) };
        if (text !== null) body.scene = text;
        this.answer = await request("POST", "v1/preview", body, COMPUTATION_ANSWER_MS);
        this.answered = now;
        if (isNew && this.on) {
          this.become(text, this.answer.scene);
          this.makeHandles();
          for (const name of this.handles.keys()) this.placeHandle(name);
        }
        if (this.on) this.handlers.preview(this.answer, body);
      } catch (problem) {
        if (problem.type?.endsWith(":superseded")) {
          // Jitter: two pages must not keep pushing each other out.
          await sleep(AGAIN_MS * (0.5 + Math.random()));
          continue;
        }
        this.answered = now;
        this.answer = null;
        // What cannot be previewed is not opened.
        if (isNew) this.text = this.shown;
        if (this.on) this.handlers.failed(problem);
      }
    }
    this.asking = false;
  }

  // The scene file with everything that was moved, or null while there is none.
  get toml() {
    return this.answered === this.wanted ? (this.answer?.scene_toml ?? null) : null;
  }

  entry(name) {
    const [, table, number] = name.match(/^(\w+)\[(\d+)\]$/);
    return { table, number, ...this.scene[LISTS[table]][number - 1], ...this.moves.get(name) };
  }

  words(name) {
    const { table, number, id, x_mm, y_mm } = this.entry(name);
    return `${table} ${id ?? number} at ${Number(x_mm.toFixed(2))}, ${Number(y_mm.toFixed(2))} mm`;
  }

  makeHandles() {
    this.handles.clear();
    for (const [table, list] of Object.entries(LISTS)) {
      this.scene[list].forEach((_, i) => this.handles.set(`${table}[${i + 1}]`, this.makeHandle(table)));
    }
    for (const [name, handle] of this.handles) this.listen(name, handle);
    // Actuators first: their circles are large, and what lies within them must stay within reach.
    const order = [...this.handles.values()].sort((a, b) => b.classList.contains("actuator") - a.classList.contains("actuator"));
    this.layer.replaceChildren(...order);
  }

  makeHandle(table) {
    return Object.assign(document.createElement("button"), { type: "button", className: `handle ${table}` });
  }

  placeHandle(name) {
    const { x_mm, y_mm, electrode_diameter_mm } = this.entry(name);
    const handle = this.handles.get(name);
    if (electrode_diameter_mm) handle.style.width = `${(100 * electrode_diameter_mm) / this.scene.length_mm}%`;
    handle.style.left = `${(100 * x_mm) / this.scene.length_mm}%`;
    handle.style.top = `${(100 * y_mm) / this.scene.width_mm}%`;
    handle.dataset.name = name;
    handle.setAttribute("aria-label", `${this.words(name)}. Arrow keys move it.`);
  }

  listen(name, handle) {
    let grab = null; // pointer, and how far from the attachment's place it took hold
    handle.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      if (grab || (event.pointerType === "mouse" && event.button !== 0)) return;
      const [from, at] = [this.entry(name), this.view.toSurface(event)];
      grab = { pointer: event.pointerId, dx: from.x_mm - at.x_mm, dy: from.y_mm - at.y_mm };
      handle.setPointerCapture(event.pointerId);
    });
    handle.addEventListener("pointermove", (event) => {
      if (grab?.pointer !== event.pointerId) return;
      const at = this.view.toSurface(event);
      this.move(name, at.x_mm + grab.dx, at.y_mm + grab.dy);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      handle.addEventListener(end, (event) => {
        if (grab?.pointer === event.pointerId) grab = null;
      });
    }
    handle.addEventListener("keydown", (event) => {
      const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!direction) return;
      event.preventDefault();
      const step = stepFor(this.scene.length_mm) * (event.shiftKey ? 10 : 1);
      const from = this.entry(name);
      this.move(name, from.x_mm + direction[0] * step, from.y_mm + direction[1] * step);
      this.handlers.placed(this.words(name));
    });
  }

  // To a place in mm, kept on the surface, at a tenth of a key's step; along its axis on a bar.
  move(name, x_mm, y_mm) {
    const grid = stepFor(this.scene.length_mm) / 10;
    const within = (value, most) => Math.min(Math.max(Number((Math.round(value / grid) * grid).toFixed(6)), 0), most);
    const place = { x_mm: within(x_mm, this.scene.length_mm) };
    if (this.scene.kind !== "bar") place.y_mm = within(y_mm, this.scene.width_mm);
    const before = this.entry(name);
    if (place.x_mm === before.x_mm && (place.y_mm ?? before.y_mm) === before.y_mm) return;
    this.moves.set(name, place);
    this.show();
  }
}
