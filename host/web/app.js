// The page of the daemon: draws the panel, sends touches, shows plan, field and device. No framework, nothing from
// elsewhere. Units as in the daemon's JSON: mm on the surface, px of the scene's screen, g.
import { Design } from "./design.js";
import { Heat } from "./heat.js";
import { Link, TOKEN, request } from "./link.js";
import { PanelView } from "./panel.js";
import { $, Readout, announce, fixed, show } from "./readout.js";
import { Studies } from "./study.js";
import { Tolerances } from "./tolerances.js";

const heat = new Heat($("heat"), $("scale"), $("ticks"));
const view = new PanelView($("panel"), heat, $("overlay"));
const readout = new Readout(clearFault, arm);
const tolerances = new Tolerances();
const fingers = new Map(); // pointer id -> {x_px, y_px}
let driven = null; // the last plan that was driven, with its touches and field
let hover = null; // the pointer's place in mm

const link = new Link({
  open() {
    show("connection", "connected");
    $("connection").className = "chip good";
    if (fingers.size) sendTouches();
    if (design.on) design.ask();
  },
  closed(seconds, refusal) {
    show("connection", refusal ? refusedInWords(refusal) : `connection lost, trying again in ${Math.ceil(seconds)} s`);
    $("connection").className = "chip bad";
    readout.forgetState();
    readout.showMode();
  },
  refused(problem) {
    if (!problem) return;
    show("connection", refusedInWords(problem));
    showProblem(withAdvice(problem));
  },
  scene(scene) {
    show("scene-name", scene.name);
    document.title = `${scene.name} – ERA haptics`;
    view.setScene(scene);
    readout.setScene(scene, view.stretch);
    design.setScene(scene);
    $("design").disabled = false;
  },
  state: showState,
  plan(message) {
    // That one is over is seen by the state.
    if (!message.plan) return;
    $("error").hidden = true;
    driven = message;
    if (!design.on) showDriven();
  },
  error: showProblem,
});

// The last plan that was driven, with its effect; nothing without one.
function showDriven() {
  showEffect(driven?.effect);
  showPlan(driven?.plan ?? null, driven?.touches ?? [], driven?.field ?? null, null, driven?.plan_id, driven?.effect);
}

function showPlan(plan, touches, field, question = null, planId = null, effect = null) {
  heat.setField(field);
  show("max-g", field ? fixed(field.max_g, 3, " g") : "0 g");
  view.setPlan(plan, touches);
  readout.showPlan(plan, planId, effect);
  tolerances.setPlan(plan, question);
  showUnder();
}

function showEffect(effect) {
  $("effect-told").hidden = !effect;
  if (!effect) return;
  const { peak_g, quiet_ms } = effect.predicted;
  const quiet = quiet_ms === null ? "" : `, quiet ${fixed(quiet_ms, 0, " ms")} after its start`;
  show("effect-told", `${effect.name.replace("_", " ")}: ${fixed(peak_g, 2, " g")} at its peak${quiet}`);
}

function showState(state) {
  readout.showState(state);
  if (state.telemetry) for (const channel of state.telemetry.channels) view.setActive(channel.actuator, channel.active);
  else view.setAllInactive();
  // Only a stop takes a plan away; one that has ended stays to be read.
  const played = driven?.effect && ["armed", "running"].includes(state.device.state);
  if (!state.plan && driven && !played) {
    driven = null;
    if (!design.on) showDriven();
  }
}

function showUnder() {
  show("under", hover ? view.describe(hover) : "");
}

function showProblem(problem) {
  const allowed = problem.allowed && !problem.detail?.includes(problem.allowed) ? ` (allowed: ${problem.allowed})` : "";
  show("error-text", `${problem.title}: ${problem.detail ?? ""}${allowed}`);
  $("error").hidden = false;
}

async function clearFault() {
  try {
    showState(await request("POST", "v1/faults/clear"));
  } catch (problem) {
    showProblem({ ...withAdvice(problem), title: "The fault is not cleared" });
  }
}

async function arm() {
  try {
    showState(await request("POST", "v1/arm"));
    $("error").hidden = true; // most likely it says that a touch was refused for want of this
  } catch (problem) {
    showProblem({ ...withAdvice(problem), title: "The device is not armed" });
  }
}

const isOf = (problem, kind) => problem.type?.endsWith(`:${kind}`);

function refusedInWords(problem) {
  if (isOf(problem, "token")) return TOKEN ? "this daemon does not know the page's token" : "this daemon requires a token";
  return isOf(problem, "role") ? "the role of the page's token is not sufficient" : "this daemon refuses the page";
}

// A problem with what to do in the page's terms, where it is about the page's token.
function withAdvice(problem) {
  if (!isOf(problem, "token") && !isOf(problem, "role")) return problem;
  const which = isOf(problem, "role") ? "a token of this role" : "a token";
  const address = `${location.origin}${location.pathname}#token=TOKEN`;
  const said = isOf(problem, "token") && !TOKEN ? "" : `${problem.detail}. `;
  return {
    ...problem,
    title: refusedInWords(problem),
    detail: `${said}Open the page with ${which} at the end of its address: ${address}. The tokens are in the daemon's --token-file.`,
  };
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
    // The socket may have carried it although HTTP did not, and then it also brought the device's state.
    const { state } = document.body.dataset;
    if (link.open && (state === "safe" || state === "discharging")) {
      show("stop-result", `stopped, the device reports it is ${state}`);
      return;
    }
    show("stop-result", "STOP not confirmed");
    showProblem({
      ...problem,
      title: "STOP was not confirmed, switch the supply off",
      detail: `${problem.detail}. The board switches itself off soon after the daemon falls silent.`,
    });
  }
}

// Design mode. Entering it stops the device, and from then on this page sends no touch.
const design = new Design(view, $("handles"), () => Number($("intensity").value), {
  pending() {
    document.body.dataset.preview = "pending";
    $("copy").disabled = true;
    $("scene-toml").hidden = true; // it would be that of another state
  },
  preview({ plan, field, tolerance, elapsed_ms }, question) {
    document.body.dataset.preview = design.toml === null ? "pending" : "ready";
    $("copy").disabled = design.toml === null;
    showPlan(plan, [question], field, question);
    readout.showPreview(plan, tolerance, elapsed_ms);
    $("preview-status").dataset.previews = Number($("preview-status").dataset.previews) + 1;
  },
  failed(problem) {
    document.body.dataset.preview = "failed";
    show("preview-status", `No preview. ${problem.title}: ${problem.detail ?? ""}`);
    announce($("preview-status").textContent);
  },
  placed: announce,
  opened(scene) {
    view.setScene(scene);
    readout.setScene(scene, view.stretch);
    show("scene-name", scene.name);
  },
});
const studies = new Studies(design);

function setDesign(on) {
  readout.preview = on;
  document.body.dataset.design = on ? "on" : "";
  document.body.dataset.preview = "";
  $("design").setAttribute("aria-pressed", String(on));
  // What is previewed is a touch that holds.
  $("effects").disabled = on;
  for (const id of ["design-tools", "design-help", "tolerances"]) $(id).hidden = !on;
  $("help").hidden = on;
  panel.setAttribute("aria-label", PANEL_LABEL[on ? "design" : "touch"]);
  if (on) {
    stop();
    // What was driven was of the daemon's panel, and says nothing of the one that is designed.
    showEffect(null);
    showPlan(null, [], null);
    show("preview-status", "Preview, nothing is driven: computing.");
    design.start(driven?.touches[0]);
    studies.watch();
  } else {
    design.end();
    showDriven();
  }
  readout.showMode();
}

async function copyScene() {
  const box = $("scene-toml");
  box.value = design.toml ?? "";
  box.hidden = false;
  box.select();
  try {
    await navigator.clipboard.writeText(box.value);
    show("preview-status", "The scene is in the clipboard.");
  } catch {
    // No clipboard without a secure context or the browser's permission.
    show("preview-status", "The browser gives no access to the clipboard: copy the selected text.");
  }
  announce($("preview-status").textContent);
}

// Touches: the whole set of fingers at every change, moves at most 30 times a second.
const MOVE_MS = 33;
// The daemon drives for at most 10 s per message; a finger that rests is told again well before.
const RENEW_MS = 3000;
let lastSent = 0;
let waiting = 0;
// What a touch plays instead of being held; it is played once, when a finger goes down.
const chosenEffect = () => document.querySelector("#effects :checked").value;

function sendTouches() {
  clearTimeout(waiting);
  waiting = 0;
  lastSent = performance.now();
  const touches = [...fingers].map(([id, at]) => ({ id, ...at }));
  const message = { type: "touch", touches, intensity_g: Number($("intensity").value) };
  if (chosenEffect()) message.effect = chosenEffect();
  if (!link.send(message) && touches.length) {
    showProblem({ title: "Not sent", detail: "there is no connection to the daemon" });
  }
}

function sendSoon() {
  if (chosenEffect()) return;
  const due = lastSent + MOVE_MS - performance.now();
  if (due <= 0) sendTouches();
  else waiting ||= setTimeout(sendTouches, due);
}

setInterval(() => {
  if (fingers.size && !chosenEffect() && performance.now() - lastSent >= RENEW_MS) sendTouches();
}, 500);

const panel = $("panel");
const PANEL_LABEL = {
  touch: panel.getAttribute("aria-label"),
  design: "Panel in design mode. Arrow keys move the cursor, Enter or Space previews a touch there, Tab goes to the attachments.",
};
let designPointer = null; // the pointer that moves the previewed touch
panel.addEventListener("pointerdown", (event) => {
  const at = view.toScreen(event);
  if (!at || (event.pointerType === "mouse" && event.button !== 0)) return;
  panel.setPointerCapture(event.pointerId);
  if (design.on) {
    designPointer = event.pointerId;
    design.setTouch(at);
    return;
  }
  fingers.set(event.pointerId, at);
  show("stop-result", "");
  sendTouches();
});
panel.addEventListener("pointermove", (event) => {
  hover = view.toSurface(event);
  showUnder();
  const at = view.toScreen(event);
  if (!at) return;
  if (design.on && event.pointerId === designPointer) design.setTouch(at);
  if (!fingers.has(event.pointerId)) return;
  fingers.set(event.pointerId, at);
  sendSoon();
});
for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
  panel.addEventListener(end, (event) => {
    if (event.pointerId === designPointer) designPointer = null;
    if (fingers.delete(event.pointerId) && !(chosenEffect() && fingers.size)) sendTouches();
  });
}
panel.addEventListener("pointerleave", () => {
  hover = null;
  showUnder();
});
panel.addEventListener("contextmenu", (event) => event.preventDefault());

// Keyboard: the cursor moves by 2 % of the screen, with Shift by 10 %; a touch lasts while the key is held.
const KEYBOARD = -1;
let keyboardTouch = false;
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
panel.addEventListener("keydown", (event) => {
  if (event.target !== panel) return; // an attachment's own keys
  const step = STEPS[event.key];
  if (step) {
    view.moveCursor(step[0], step[1], event.shiftKey ? 0.1 : 0.02);
    hover = view.cursor && view.cursorPlace();
    showUnder();
    announce(`cursor at ${$("under").textContent}`);
    if (keyboardTouch) {
      fingers.set(KEYBOARD, view.cursor);
      sendSoon();
    }
  } else if (event.key === "Enter" || event.key === " ") {
    if (design.on) {
      design.setTouch(view.cursor);
    } else if (!event.repeat && view.cursor) {
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
  const text = fixed(Number($("intensity").value), 2, " g");
  show("intensity-value", text);
  $("intensity").setAttribute("aria-valuetext", text);
  if (design.on) design.ask();
  else if (fingers.size) sendSoon();
});

$("design").addEventListener("click", () => setDesign(!design.on));
$("reset").addEventListener("click", () => design.reset());
$("copy").addEventListener("click", copyScene);
$("scale-top").addEventListener("change", () => heat.setScale(Number($("scale-top").value) || null));
$("dismiss").addEventListener("click", () => {
  $("error").hidden = true;
});

link.start();
