// Design mode's studies: a small one of the scene at hand, run by the daemon, and the best designs of any study, opened from their files.
import { follow, showProgress, underWay } from "./job.js";
import { COMPUTATION_ANSWER_MS, request } from "./link.js";
import { $, announce, fixed, show } from "./readout.js";

// Of the page's own study: some seconds on half of two processors.
const DESIGNS = 256;
// From the edge to where an actuator's middle may be, as a part of the shorter side.
const MARGIN = 0.05;
// Between two electrodes, in mm.
const CLEARANCE_MM = 2;

// The study file for: where do the actuators go, so that the weakest place is as strong as can be?
export function placement(scene) {
  const isBar = scene.kind === "bar";
  const margin = MARGIN * Math.min(scene.length_mm, isBar ? scene.length_mm : scene.width_mm);
  const [right, bottom] = [scene.length_mm - margin, scene.width_mm - margin].map((mm) => Number(mm.toFixed(6)));
  const from = Number(margin.toFixed(6));
  const parts = ['version = 1', 'name = "where the actuators go"', 'scene = "page"'];
  for (let number = 1; number <= scene.actuators.length; number += 1) {
    // By its number: an id may have any characters in it.
    const path = `actuator[${number}]`;
    parts.push("", "[[variable]]");
    if (isBar) parts.push(`key = '${path}.x_mm'`, `from = ${from}`, `to = ${right}`);
    else parts.push(`place = '${path}'`, `within_mm = [${from}, ${from}, ${right}, ${bottom}]`);
  }
  if (scene.actuators.length > 1) {
    const widest = Math.max(...scene.actuators.map((actuator) => actuator.electrode_diameter_mm ?? 0));
    // So far apart that there is room for all of them.
    const most = 0.4 * (isBar ? scene.length_mm / scene.actuators.length : Math.min(scene.length_mm, scene.width_mm));
    const distance = Math.min(widest + CLEARANCE_MM, most);
    parts.push("", "[[apart]]", 'places = ["actuator.*"]', `distance_mm = ${Number(distance.toFixed(6))}`);
  }
  parts.push("", "[[wish]]", 'figure = "weakest_g"', "", "[method]", 'way = "sobol"', `designs = ${DESIGNS}`, "");
  return parts.join("\n");
}

export class Studies {
  // design: the Design.
  constructor(design) {
    this.design = design;
    this.watching = false;
    $("study-run").addEventListener("click", () => this.run());
    $("study-stop").addEventListener("click", () => this.stop());
    $("open-scenes").addEventListener("change", (event) => this.openFiles(event.target));
  }

  // Of the scene at hand with everything that was moved: the page's own study, or the file that was chosen.
  async run() {
    const [file] = $("study-file").files;
    const body = { study: file ? await file.text() : placement(this.design.scene) };
    const text = this.design.toml ?? this.design.text;
    if (text) body.scene = text;
    // A second request would wait for its check, to be refused beside the study that runs.
    $("study-run").disabled = true;
    try {
      this.show(await request("POST", "v1/study", body, COMPUTATION_ANSWER_MS));
    } catch (problem) {
      this.tell(`No study. ${problem.title}: ${problem.detail ?? ""}`);
      return;
    } finally {
      $("study-run").disabled = false;
    }
    this.watch();
  }

  async stop() {
    try {
      this.show(await request("POST", "v1/study/stop"));
    } catch (problem) {
      this.tell(`The study is not stopped: ${problem.detail ?? problem.title}`);
    }
  }

  // Shows how far the daemon's study is until it ends; somebody else may have begun it.
  async watch() {
    if (this.watching) return;
    this.watching = true;
    try {
      await follow("v1/study", (study) => this.show(study));
    } catch (problem) {
      this.tell(`The progress of the study is not known: ${problem.detail ?? problem.title}`);
    }
    this.watching = false;
  }

  show(study) {
    const isOn = underWay(study);
    $("study-run").disabled = isOn;
    $("study-stop").disabled = !isOn;
    showProgress($("study-progress"), study);
    const words = {
      none: "",
      running: `${study.name}: ${study.there} of ${study.all} designs`,
      finishing: `${study.name}: computing the best designs again`,
      done: `${study.name}: ${study.all} designs, ${this.outcome(study)}`,
      stopped: `${study.name}: stopped`,
      failed: `${study.name}: ${study.problem}`,
    }[study.stage];
    document.body.dataset.study = study.stage;
    if (isOn) show("study-status", words);
    else if (words !== $("study-status").textContent) this.tell(words);
    if (study.stage !== "done") return;
    const all = [["unchanged scene", study.as_it_is], ...study.best.map((own, k) => [`best ${k + 1}`, own])];
    this.list(all.map(([name, own]) => [`${name}: ${this.figures(own)}`, own.scene_toml]));
  }

  outcome({ best, nearest, all_failed: reason }) {
    if (best.length) return "the best are below";
    if (reason) return `all of which failed; the first: ${reason}`;
    const near = nearest ? `; design ${nearest.design} comes nearest to the limits: ${nearest.reason}` : "";
    return `none of which meets all limits${near}`;
  }

  figures(own) {
    if (own.failed) return `failed: ${own.failed}`;
    const told = Object.entries(own.figures).map(([name, value]) => `${name} ${fixed(value, 3, "")}`);
    told.push(...Object.entries(own.worst).map(([name, value]) => `${name} ${fixed(value, 3, "")} at worst`));
    if (own.breaks) told.push(`breaks a limit: ${own.breaks}`);
    return told.join(", ");
  }

  // Buttons that open scenes: [words, file] each.
  list(scenes) {
    const buttons = scenes.map(([words, text]) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: words });
      button.addEventListener("click", () => this.design.open(text));
      const entry = document.createElement("li");
      entry.append(button);
      return entry;
    });
    $("designs").replaceChildren(...buttons);
  }

  // Files of scenes, the best-1.toml, best-2.toml, ... of a study among them, whose first lines say what they are.
  async openFiles(input) {
    const scenes = await Promise.all(
      [...input.files].map(async (file) => {
        const text = await file.text();
        const told = text
          .split("\n")
          .filter((line) => /^# (\S+ = |In the thorough evaluation|Computed (again|anew))/.test(line))
          .map((line) => line.slice(2));
        return [[file.name, ...told].join(", "), text];
      }),
    );
    this.list(scenes);
    if (scenes.length) this.design.open(scenes[0][1]);
    input.value = ""; // the same files can be opened again after they have changed
  }

  tell(words) {
    show("study-status", words);
    announce(words);
  }
}
