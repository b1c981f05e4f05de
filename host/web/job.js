// Work of the daemon that takes some seconds, of which there is one piece at a time: a study, or a look at tolerances.
import { request } from "./link.js";

// Between two looks how far it is.
const LOOK_MS = 400;

export const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
export const underWay = (job) => job.stage === "running" || job.stage === "finishing";

// Tells `seen` how far the work at a path is, until it ends or `seen` says false; throws the daemon's problem.
export async function follow(path, seen) {
  for (;;) {
    const job = await request("GET", path);
    if (seen(job) === false || !underWay(job)) return;
    await sleep(LOOK_MS);
  }
}

// Shows in a <progress> how far it is, while it is under way.
export function showProgress(bar, job) {
  bar.hidden = !underWay(job);
  Object.assign(bar, { max: job.all || 1, value: job.there });
}
