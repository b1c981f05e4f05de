// The words and numbers beside the panel: plan, device, faults, measured acceleration.

const HISTORY_MS = 20_000;
const HISTORY_STEP_MS = 100;
const ANNOUNCE_MS = 700;

export const $ = (id) => document.getElementById(id);

export function show(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

export const fixed = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)}${unit}` : "–");

const node = (tag, properties, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};

// A cell with a number and, smaller under it, what goes with it.
const cell = (text, under, className = "") =>
  node("td", { className }, text, ...(under ? [node("small", { textContent: under })] : []));

let announcing = 0;
let announced = "";

// Says something to a screen reader once things have come to rest, so that a moving finger does not flood it.
export function announce(words) {
  if (words === announced) return;
  announced = words;
  clearTimeout(announcing);
  announcing = setTimeout(() => show("announce", words), ANNOUNCE_MS);
}

function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 120) return `${seconds.toFixed(0)} s`;
  return seconds < 7200 ? `${(seconds / 60).toFixed(0)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

// One digit, rounded up: a bound that is rounded down does not hold.
const boundInWords = ({ error_bound }) => {
  if (error_bound === null) return "not known";
  const percent = error_bound * 100;
  const unit = percent > 0 ? 10 ** Math.floor(Math.log10(percent)) : 1;
  return `± ${Number((Math.ceil(percent / unit) * unit).toPrecision(1))} %`;
};

const STATE_WORDS = {
  boot: "starting",
  safe: "safe, all off",
  discharging: "off, discharging",
  arming: "testing itself",
  armed: "armed, not driving",
  running: "running",
  fault: "fault, all off",
};

// Above this a rail is dangerous to touch, in V; as the daemon's board has it.
const SAFE_V = 60;

// What a device that drives nothing is in, for a plan that is over.
const IDLE_WORDS = { ...STATE_WORDS, safe: "device off", fault: "device off", armed: "device armed", arming: "device arms",
  boot: "device starts", discharging: "device switches off", unknown: "device unknown" };

export class Readout {
  constructor(clearFault, arm) {
    Object.assign(this, { clearFault, arm, scene: null, plan: null, planId: null, state: "unknown", rails: null, telemetry: null,
      effect: null, history: [], preview: false });
  }

  setScene(scene, stretch) {
    this.scene = scene;
    const { length_mm, width_mm, thickness_mm, kind } = scene;
    const size = [length_mm, width_mm, thickness_mm].map((mm) => Number(mm.toPrecision(4))).join(" × ");
    show("facts", `${kind}, ${size} mm${stretch > 1 ? ", height not to scale" : ""}`);
    this.showPlan(this.plan, this.planId, this.effect);
  }

  // planId: the daemon's number for a plan that is or was driven; null for one that is only previewed.
  // effect: what is played of the plan; null if it is driven evenly.
  showPlan(plan, planId = null, effect = null) {
    Object.assign(this, { plan, planId, effect });
    document.body.dataset.plan = plan ? JSON.stringify(plan) : "";
    this.fillDrives();
    const predicted = plan?.predicted ?? {};
    show("target-g", fixed(predicted.target_peak_g, 3, " g") + this.sensorInWords());
    show("bound", plan ? boundInWords(plan) : "–");
    show("elsewhere-g", fixed(predicted.mean_elsewhere_g, 3, " g"));
    show("contrast", fixed(this.contrastDb(), 1, " dB"));
    show("elapsed", plan ? `found in ${fixed(plan.elapsed_us / 1e3, 2, " ms")}` : "");
    this.showLimit(plan);
    const several = plan?.targets.length > 1;
    $("target-table").hidden = !several;
    if (several) {
      $("target-table").tBodies[0].replaceChildren(...plan.targets.map((target, i) => node("tr", {},
        cell(`${i + 1}`), cell(`${target.x_mm.toFixed(0)}, ${target.y_mm.toFixed(0)} mm`),
        cell(fixed(target.wanted_g, 2, " g")), cell(fixed(target.peak_g, 3, " g")))));
    }
    this.showMode();
    this.showMeasured();
    if (plan) announce(this.planInWords(plan));
  }

  // That of a click of single windows, else that of the steady drives.
  contrastDb() {
    return this.effect?.predicted?.contrast_db ?? this.plan?.predicted?.contrast_db;
  }

  // Of a click of single windows: "measured" is of all motion below 1 kHz, of which the skin feels a part.
  sensorInWords() {
    const shown = this.effect?.windows?.length ? this.effect.predicted.peak_most_g : NaN;
    return Number.isFinite(shown) ? ` felt, ${fixed(shown, 3, " g on a sensor")}` : "";
  }

  fillDrives() {
    if (!this.scene) return;
    const rows = this.scene.actuators.map(({ id, max_voltage_v }) => {
      const drive = this.plan?.drives.find((candidate) => candidate.actuator === id);
      const row = node("tr", {});
      row.dataset.actuator = id;
      if (drive) {
        // The force goes with the square of the voltage.
        const part = (drive.voltage_v / max_voltage_v) ** 2;
        const degrees = Math.round((drive.phase_rad * 180) / Math.PI);
        row.append(cell(id, `${degrees}° · ${fixed(drive.pulse_width, 2, "")}`), cell(fixed(drive.frequency_hz, 1, " Hz")),
          cell(fixed(drive.voltage_v, 0, " V"), `of ${max_voltage_v.toFixed(0)}`),
          cell(fixed(drive.force_n * 1e3, 1, " mN"), `${(part * 100).toFixed(0)} %`), cell("off"));
        row.title = "under the name: phase of the windows, pulse width; under the force: its fraction of the force that the voltage allows";
        const bar = node("meter", { min: 0, max: 1, value: part });
        bar.setAttribute("aria-label", `${(part * 100).toFixed(0)} % of the force that the voltage allows`);
        row.children[3].append(bar);
      } else {
        row.append(cell(id), cell("–"), cell("–"), cell("–"), cell("off"));
      }
      return row;
    });
    if (rows.length === 0) rows.push(node("tr", {}, node("td", { colSpan: 5, textContent: "this scene has no actuators" })));
    $("plan-table").tBodies[0].replaceChildren(...rows);
    this.showChannels();
  }

  showLimit(plan) {
    const target = plan?.targets[0];
    $("limited").hidden = !plan?.limited_by;
    show("limited", plan?.limited_by
      ? `Limited by ${plan.limited_by}: ${fixed(target?.peak_g, 2, "")} of ${fixed(target?.wanted_g, 2, " g")}.` : "");
  }

  planInWords(plan) {
    const [x, y] = plan.target_mm;
    const drives = plan.drives.map((drive) =>
      `${drive.actuator} ${drive.frequency_hz.toFixed(0)} hertz ${drive.voltage_v.toFixed(0)} volts`).join(", ");
    const { target_peak_g } = plan.predicted;
    return `Touch at ${x.toFixed(0)}, ${y.toFixed(0)} millimetres: ${drives}. Predicted ${target_peak_g.toFixed(2)} g, ` +
      `contrast ${this.contrastDb().toFixed(0)} decibels.${plan.limited_by ? ` Limited by ${plan.limited_by}.` : ""}`;
  }

  // Without a link nothing is known of the device.
  forgetState() {
    Object.assign(this, { state: "unknown", rails: null, telemetry: null });
    document.body.dataset.state = "unknown";
    show("state", "device unknown");
    this.showMeasured();
    this.channels = null;
    this.showChannels();
  }

  showState(state) {
    const { device, telemetry, link: traffic, daemon } = state;
    const before = this.state;
    this.state = device.connected ? (device.state ?? "unknown") : "unknown";
    document.body.dataset.state = this.state;
    const words = device.connected ? (STATE_WORDS[device.state] ?? device.state ?? "device unknown") : "device not connected";
    show("state", words);
    this.channels = telemetry?.channels ?? null;
    this.showChannels();
    this.telemetry = telemetry;
    this.rails = device.supply?.rail_v ?? null;
    this.showMeasured();
    // The curve stops with what is known.
    if (this.state !== "unknown") this.addToHistory(telemetry?.acceleration_recent_g ?? NaN);
    show("kind", device.kind ?? "–");
    show("port", device.port ?? "–");
    show("firmware", device.firmware ?? "–");
    show("protocol", `${device.protocol ?? "–"}`);
    show("round-trip", fixed(traffic.round_trip_ms_median ?? NaN, 1, " ms"));
    show("bad-frames", String(traffic.crc_errors));
    show("reset-cause", device.reset_cause ?? "–");
    show("uptime", duration(telemetry ? telemetry.uptime_ms / 1e3 : NaN));
    show("board-id", device.board_id ?? "–");
    for (const id of ["board-id", "port", "firmware"]) $(id).title = $(id).textContent;
    show("daemon", `${daemon.version}, up ${duration(daemon.uptime_s)}`);
    this.showFault(device);
    this.showMode();
    if (before !== this.state) {
      // A plan that was just announced says more than "running".
      if (this.state !== "running") announce(`Device ${words}`);
    }
  }

  showChannels() {
    for (const row of $("plan-table").querySelectorAll("tr[data-actuator]")) {
      const channel = this.channels?.find((channel) => channel.actuator === row.dataset.actuator);
      // Of a device that is gone nobody knows what it does.
      if (this.channels && !channel) continue;
      const text = !channel ? "unknown" : channel.active ? "on" : "off";
      const under = channel?.active ? `${channel.voltage_v.toFixed(0)} V` : "";
      const old = row.lastElementChild;
      if (old.dataset.shown === text + under) continue;
      const fresh = cell(text, under, channel?.active ? "on" : "");
      fresh.dataset.shown = text + under;
      old.replaceWith(fresh);
    }
  }

  // In design mode: what the preview says of itself, and of what it does not do.
  showPreview(plan, tolerance, elapsed_ms) {
    const bound = plan.error_bound === null
      ? `no error bound, computed for a tolerance of ${tolerance * 100} %`
      : `error at most ${boundInWords(plan)} at the target`;
    show("preview-status", `Preview, nothing is driven: ${bound}, computed in ${fixed(elapsed_ms, 0, " ms")}.`);
    show("elapsed", "preview");
  }

  // Whether the map shows what happens now, what happened last, or what would happen.
  showMode() {
    const driving = this.state === "running";
    document.body.dataset.driving = String(driving && !this.preview);
    const rails = this.railsInWords();
    if (this.preview) {
      const idle = rails ? `preview, nothing is driven; ${IDLE_WORDS[this.state]}, ${rails}` : "preview, nothing is driven";
      show("mode", driving ? "preview; another client drives the device" : idle);
      return;
    }
    const idle = `last plan, ${IDLE_WORDS[this.state] ?? this.state}${rails ? `, ${rails}` : ""}`;
    show("mode", this.plan ? (driving ? "driving now" : idle) : "");
  }

  // What stands on the rails where that is dangerous, or may be: they stay up after a drive until the device disarms itself. Empty if all are down.
  railsInWords() {
    if (this.state === "unknown") return "";
    const live = this.state === "armed" || this.state === "arming";
    if (!this.rails) return live ? "rails may be up" : "";
    const up = this.rails.filter((volts) => volts >= SAFE_V);
    return up.length ? `rails up (${up.map((volts) => volts.toFixed(0)).join(" and ")} V)` : "";
  }

  // The sensor's peak for the plan that is shown, kept for as long as it is shown; without one what the sensor shows now. A previewed plan has none: it
  // is of another panel.
  showMeasured() {
    const own = this.telemetry?.touch_peaks.find((peak) => peak.plan_id === this.planId);
    const now = this.plan ? NaN : (this.telemetry?.acceleration_recent_g ?? NaN);
    show("measured-g", fixed(this.preview ? NaN : (own?.peak_g ?? now), 3, " g"));
  }

  showFault(device) {
    const box = $("fault");
    const count = device.fault?.count > 1 ? `, ${device.fault.count} times` : "";
    const lost = `The device does not answer. ${device.problem ?? ""}`;
    const away = "The device had an outage. Check that nobody touches it, then arm it.";
    let [text, button, act] = ["", "", null];
    if (device.fault) {
      text = `Fault ${device.fault.code} (${device.fault.name}${count}). ${device.fault.message}`;
      [button, act] = ["Clear the fault", this.clearFault];
    } else if (!device.connected) {
      text = lost;
    } else if (device.waits_to_be_armed) {
      [text, button, act] = [away, "Arm the device", this.arm];
    }
    if (box.dataset.text === text) return;
    box.dataset.text = text;
    box.hidden = !text;
    box.replaceChildren(text);
    if (act) {
      const made = node("button", { type: "button", textContent: button });
      made.addEventListener("click", act);
      box.append(made);
    }
  }

  addToHistory(measured) {
    const now = performance.now();
    const { history } = this;
    const predicted = this.state === "running" && this.plan && !this.preview ? this.plan.predicted.target_peak_g : 0;
    const seen = Number.isFinite(measured) ? measured : 0;
    const last = history.at(-1);
    if (last && now - last.now < HISTORY_STEP_MS) {
      // A peak that comes between two steps of the curve is in it all the same.
      Object.assign(last, { measured: Math.max(last.measured, seen), predicted: Math.max(last.predicted, predicted) });
    } else {
      history.push({ now, measured: seen, predicted });
    }
    while (now - history[0].now > HISTORY_MS) history.shift();
    const most = Math.max(...history.map((entry) => Math.max(entry.measured, entry.predicted)));
    const top = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20].find((value) => value >= most) ?? most;
    show("history-top", `${Number(top.toPrecision(3))} g`);
    for (const key of ["measured", "predicted"]) {
      const points = history.map((entry) => {
        const x = 200 * (1 - (now - entry.now) / HISTORY_MS);
        return `${x.toFixed(1)},${(39 - (37 * entry[key]) / top).toFixed(1)}`;
      });
      $(`history-${key}`).setAttribute("points", points.join(" "));
    }
  }
}
