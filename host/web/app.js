// The page of the daemon: draws the panel, sends touches, shows plan, field and device. No framework, nothing from
// elsewhere. Units as in the daemon's JSON: mm on the surface, px of the scene's screen, g.
import { PanelView, drawScale } from "./panel.js";
import { Link, request } from "./link.js";

const $ = (id) => document.getElementById(id);
const view = new PanelView($("panel"), $("heat"), $("overlay"));
const fingers = new Map(); // pointer id -> {x_px, y_px}
let plan = null;
let announced = "";

const link = new Link({
  open() {
    show("connection", "connected");
    $("connection").className = "chip good";
    if (fingers.size) sendTouches();
  },
  closed(seconds) {
    show("connection", `connection lost, trying again in ${Math.ceil(seconds)} s`);
    $("connection").className = "chip bad";
    document.body.dataset.state = "unknown";
    show("state", "unknown");
  },
  scene(scene) {
    show("scene-name", scene.name);
    document.title = `${scene.name} – ERA haptics`;
    view.setScene(scene);
  },
  state: showState,
  plan(message) {
    showPlan(message.plan);
    view.setTouches(message.touches);
    showField(message.field);
  },
  error: showProblem,
});

function show(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

const fixed = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)}${unit}` : "–");

function showField(field) {
  view.setField(field);
  show("max-g", fixed(field.max_g, 3, " g"));
}

function showPlan(next) {
  plan = next;
  document.body.dataset.plan = plan ? JSON.stringify(plan) : "";
  const rows = (plan?.drives ?? []).map((drive) => {
    const cells = [
      drive.actuator,
      fixed(drive.frequency_hz, 1, " Hz"),
      fixed(drive.voltage_v, 0, " V"),
      fixed(drive.force_n * 1e3, 1, " mN"),
      "",
    ];
    const row = document.createElement("tr");
    row.dataset.actuator = drive.actuator;
    row.append(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return row;
  });
  if (rows.length) $("plan-table").tBodies[0].replaceChildren(...rows);
  const predicted = plan?.predicted ?? {};
  show("target-g", fixed(predicted.target_peak_g, 3, " g"));
  show("elsewhere-g", fixed(predicted.mean_elsewhere_g, 3, " g"));
  show("contrast", fixed(predicted.contrast_db, 1, " dB"));
  $("limited").hidden = !plan?.limited_by;
  show("limited", plan?.limited_by ? `limited by ${plan.limited_by}` : "");
  view.setPlan(plan);
  if (plan) $("error").hidden = true;
}

function showState(state) {
  const { device, telemetry, link: traffic } = state;
  const name = device.connected ? (device.state ?? "unknown") : "not connected";
  document.body.dataset.state = device.connected ? (device.state ?? "unknown") : "unknown";
  show("state", name);
  show("kind", device.kind ?? "–");
  show("port", device.port ?? "–");
  show("firmware", device.firmware ?? "–");
  show("protocol", device.protocol === null ? "–" : String(device.protocol));
  show("round-trip", fixed(traffic.round_trip_ms_median ?? NaN, 1, " ms"));
  show("bad-frames", String(traffic.crc_errors));
  show("measured-g", fixed(telemetry?.acceleration_peak_g ?? NaN, 3, " g"));
  for (const channel of telemetry?.channels ?? []) {
    const cell = $("plan-table").querySelector(`tr[data-actuator="${CSS.escape(channel.actuator ?? "")}"] td:last-child`);
    if (cell) {
      cell.textContent = channel.active ? "on" : "off";
      cell.className = channel.active ? "on" : "";
    }
    view.setActive(channel.actuator, channel.active);
  }
  showFault(device);
  if (!state.plan && plan) {
    showPlan(null);
    view.setTouches([]);
    view.clearField();
    show("max-g", "0 g");
  }
  const words = `device ${name}${device.fault ? `, fault ${device.fault.name}` : ""}`;
  if (words !== announced) {
    announced = words;
    show("announce", words);
  }
}

function showFault(device) {
  const box = $("fault");
  const text = device.fault
    ? `Fault ${device.fault.code} (${device.fault.name}). ${device.fault.message}`
    : device.connected ? "" : `The device does not answer. ${device.problem ?? ""}`;
  if (box.dataset.text === text) return;
  box.dataset.text = text;
  box.hidden = !text;
  box.replaceChildren(text);
  if (device.fault) {
    const clear = Object.assign(document.createElement("button"), { type: "button", textContent: "Clear the fault" });
    clear.addEventListener("click", () => post("/v1/faults/clear"));
    box.append(clear);
  }
}

function showProblem(problem) {
  $("error").hidden = false;
  show("error", `${problem.title}: ${problem.detail}`);
}

async function post(path) {
  try {
    showState(await request("POST", path));
  } catch (problem) {
    showProblem(problem);
  }
}

let stopping = 0;

// Stop goes both ways, so that it works even if the socket is dead and nobody has noticed yet.
async function stop() {
  fingers.clear();
  keyboardTouch = false;
  const attempt = ++stopping;
  show("stop-result", "stopping");
  try {
    showState(await link.stop());
    if (attempt === stopping) show("stop-result", "stopped, confirmed by the daemon");
  } catch (problem) {
    show("stop-result", "STOP not confirmed");
    showProblem({
      ...problem,
      title: "STOP was not confirmed, switch the supply off",
      detail: `${problem.detail}. The board switches itself off soon after the daemon falls silent.`,
    });
  }
}

// Touches: the whole set of fingers at every change, moves at most 30 times a second.
const MOVE_MS = 33;
// The daemon drives for at most 10 s per message; a finger that rests is told again well before.
const RENEW_MS = 3000;
let lastSent = 0;
let waiting = 0;

function sendTouches() {
  clearTimeout(waiting);
  waiting = 0;
  lastSent = performance.now();
  const touches = [...fingers].map(([id, at]) => ({ id, ...at }));
  if (!link.send({ type: "touch", touches, intensity_g: Number($("intensity").value) }) && touches.length) {
    showProblem({ title: "Not sent", detail: "there is no connection to the daemon" });
  }
}

function sendSoon() {
  const due = lastSent + MOVE_MS - performance.now();
  if (due <= 0) sendTouches();
  else waiting ||= setTimeout(sendTouches, due);
}

setInterval(() => {
  if (fingers.size && performance.now() - lastSent >= RENEW_MS) sendTouches();
}, 500);

const panel = $("panel");
panel.addEventListener("pointerdown", (event) => {
  const at = view.toScreen(event);
  if (!at || (event.pointerType === "mouse" && event.button !== 0)) return;
  panel.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, at);
  show("stop-result", "");
  sendTouches();
});
panel.addEventListener("pointermove", (event) => {
  show("under", view.describe(event));
  if (!fingers.has(event.pointerId)) return;
  const at = view.toScreen(event);
  if (!at) return;
  fingers.set(event.pointerId, at);
  sendSoon();
});
for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
  panel.addEventListener(end, (event) => {
    if (fingers.delete(event.pointerId)) sendTouches();
  });
}
panel.addEventListener("pointerleave", () => show("under", "\u00a0"));
panel.addEventListener("contextmenu", (event) => event.preventDefault());

// Keyboard: the cursor moves by 2 % of the screen, with Shift by 10 %; a touch lasts while the key is held.
const KEYBOARD = -1;
let keyboardTouch = false;
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
panel.addEventListener("keydown", (event) => {
  const step = STEPS[event.key];
  if (step) {
    view.moveCursor(step[0], step[1], event.shiftKey ? 0.1 : 0.02);
    if (keyboardTouch) {
      fingers.set(KEYBOARD, view.cursor);
      sendSoon();
    }
  } else if (event.key === "Enter" || event.key === " ") {
    if (!event.repeat && view.cursor) {
      keyboardTouch = true;
      show("stop-result", "");
      fingers.set(KEYBOARD, view.cursor);
      sendTouches();
    }
  } else {
    return;
  }
  event.preventDefault();
});
function endKeyboardTouch() {
  keyboardTouch = false;
  if (fingers.delete(KEYBOARD)) sendTouches();
}
panel.addEventListener("keyup", (event) => {
  if (event.key === "Enter" || event.key === " ") endKeyboardTouch();
});
panel.addEventListener("blur", () => {
  endKeyboardTouch();
  view.showCursor(false);
});
panel.addEventListener("focus", () => view.showCursor(panel.matches(":focus-visible")));

document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") stop();
});
// A page that is hidden has no finger on it.
document.addEventListener("visibilitychange", () => {
  if (document.hidden && fingers.size) {
    fingers.clear();
    sendTouches();
  }
});
// On the press, not on its end. The click that follows is skipped; one without a press comes from keyboard or software.
let pressed = -Infinity;
$("stop").addEventListener("pointerdown", () => {
  pressed = performance.now();
  stop();
});
$("stop").addEventListener("click", () => {
  if (performance.now() - pressed > 1000) stop();
});
$("intensity").addEventListener("input", () => {
  show("intensity-value", `${Number($("intensity").value).toFixed(2)} g`);
  if (fingers.size) sendSoon();
});

drawScale($("scale"));
link.start();
