// Design mode: what tolerances do to the plan that is previewed. The daemon looks at its drives on panels that are a little off; it stands
// beside the error bound, which is against the scene as it is written and says nothing of these.
import { follow, showProgress, underWay } from "./job.js";
import { COMPUTATION_ANSWER_MS, request } from "./link.js";
import { $, announce, fixed, show } from "./readout.js";

const PATH = "v1/tolerances";
const UNKNOWN = "not computed";

export class Tolerances {
  constructor() {
    this.plan = null; // the one that is shown
    this.question = null; // what it was previewed for; null while it is driven, as it is gone when the finger is lifted
    this.look = null; // the newest look at it: {key: its question as text, id: the daemon's number for it}
    this.busy = false; // whether one of this page's looks is under way
    $("tolerances-run").addEventListener("click", () => this.run());
    $("tolerances-stop").addEventListener("click", () => this.stop());
  }

  // The plan that is shown from here on (null: none), and what it was previewed for.
  setPlan(plan, question) {
    Object.assign(this, { plan, question });
    if (this.look && this.look.key !== JSON.stringify(this.question)) {
      if (this.busy) this.stop();
      this.forget(this.busy ? "Stopped because the plan has changed." : "");
    }
    if (!this.look) show("off-g", plan ? UNKNOWN : "–");
    this.showButtons();
  }

  async run() {
    const { question } = this;
    const look = { key: JSON.stringify(question), id: null };
    this.look = look;
    this.busy = true;
    show("off-g", UNKNOWN);
    show("tolerances-status", "");
    this.showButtons();
    try {
      const begun = await request("POST", PATH, question, COMPUTATION_ANSWER_MS);
      look.id = begun.id;
      this.showButtons();
      // The plan has changed meanwhile.
      if (this.look !== look) await this.stop();
      await follow(PATH, (told) => this.seen(look, told));
    } catch (problem) {
      if (this.look === look) this.forget(`Tolerances are not known. ${problem.title}: ${problem.detail ?? ""}`);
    }
    this.busy = false;
    this.showButtons();
  }

  // How far a look is; false where it is of no account any more.
  seen(look, told) {
    if (told.id !== look.id) {
      if (this.look === look) this.forget("Another client has started another tolerance study since.");
      return false;
    }
    if (this.look !== look) return true; // until it has ended, and another one may begin
    showProgress($("tolerances-progress"), told);
    document.body.dataset.tolerances = told.stage;
    if (underWay(told)) {
      show("tolerances-status", `computing panels with deviations: ${told.there} of ${told.all}`);
    } else if (told.stage === "done") {
      const peak = (db) => told.plan.predicted.target_peak_g * 10 ** (db / 20);
      show("off-g", `${fixed(peak(told.off.least_db), 3, "")} to ${fixed(peak(told.off.most_db), 3, " g")}`);
      this.tell(told.words);
    } else {
      this.forget(told.problem ? `Tolerances are not known: ${told.problem}` : "Stopped.");
      document.body.dataset.tolerances = told.stage;
    }
    return true;
  }

  async stop() {
    try {
      await request("POST", `${PATH}/stop`);
    } catch (problem) {
      this.tell(`The tolerance study is not stopped: ${problem.detail ?? problem.title}`);
    }
  }

  forget(words) {
    this.look = null;
    document.body.dataset.tolerances = "";
    $("tolerances-progress").hidden = true;
    if (this.plan) show("off-g", UNKNOWN);
    this.tell(words);
  }

  showButtons() {
    $("tolerances-run").disabled = this.busy || !this.question;
    // Before it has begun there is nothing to be stopped.
    $("tolerances-stop").hidden = !this.busy || !this.look?.id;
  }

  tell(words) {
    show("tolerances-status", words);
    if (words) announce(words);
  }
}
