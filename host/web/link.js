// The way to the daemon: a WebSocket that comes back by itself, and plain HTTP beside it.

const FIRST_WAIT_S = 0.5;
const LONGEST_WAIT_S = 8;
// The daemon reports the device about five times a second; a silence of 20 reports deserves a question.
const SILENCE_MS = 4000;
const ANSWER_MS = 3000;
// What is computed before it is answered, at the limits of scenes and studies, takes some seconds, and waits for its turn.
export const COMPUTATION_ANSWER_MS = 30_000;
const STOP_TRIES = 3;

// A daemon that asks for a token is opened with it behind its address, as #token=SECRET: that part of an address stays in the
// browser.
export const TOKEN = new URLSearchParams(location.hash.slice(1)).get("token")?.trim();

// Paths are relative to the page's address: a reverse proxy may serve it below a prefix, as /era/.

// The answer's body, to a question with an optional body of its own; throws a problem in the form of the daemon's
// problem+json, whatever went wrong.
export async function request(method, path, content, answer_ms = ANSWER_MS) {
  let answer;
  try {
    // A redirect that is followed makes a GET of a POST.
    const options = { method, cache: "no-store", redirect: "manual", signal: AbortSignal.timeout(answer_ms) };
    if (content === undefined) options.keepalive = method === "POST"; // a stop goes out even if the page goes away
    else options.body = JSON.stringify(content);
    if (TOKEN) options.headers = { authorization: `Bearer ${TOKEN}` };
    answer = await fetch(path, options);
  } catch (error) {
    const late = error.name === "TimeoutError";
    const detail = late ? `no answer came within ${answer_ms / 1000} s` : "the request could not be delivered";
    throw { title: "No answer from the daemon", detail };
  }
  if (answer.type === "opaqueredirect") {
    const detail = "a server in front of the daemon redirects the request, but the page does not follow redirects: open the page at the daemon's own address";
    throw { title: "The request did not reach the daemon", detail };
  }
  const body = await answer.json().catch(() => null);
  if (answer.ok && body) return body;
  throw body?.title ? body : { title: "No usable answer from the daemon", detail: `HTTP status ${answer.status}` };
}

export class Link {
  // handlers: open(), closed(seconds until the next attempt, the problem if the daemon refuses this page), and one per message type: scene, state, plan, error.
  constructor(handlers) {
    this.handlers = handlers;
    this.wait = FIRST_WAIT_S;
    this.socket = null;
    this.timer = 0;
    this.heard = 0;
    this.asking = false;
    this.refusal = null;
  }

  start() {
    // A token that is put behind the address of an open page takes no effect by itself.
    addEventListener("hashchange", () => location.reload());
    this.connect();
    setInterval(() => this.watch(), 1000);
    addEventListener("online", () => this.retry());
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) this.retry();
    });
  }

  connect() {
    clearTimeout(this.timer);
    const query = new URLSearchParams({ send: "scene,state,plan,field" }); // maps come only to those who ask for them
    if (TOKEN) query.set("token", TOKEN);
    const address = new URL(`v1/live?${query}`, document.baseURI);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    this.heard = performance.now();
    socket.addEventListener("open", () => {
      if (this.socket !== socket) return;
      this.refusal = null;
      this.handlers.open();
    });
    socket.addEventListener("message", (event) => {
      if (this.socket !== socket) return;
      this.heard = performance.now();
      // Only a message makes a link good: one that opens and closes at once must keep waiting longer.
      this.wait = FIRST_WAIT_S;
      this.deliver(JSON.parse(event.data));
    });
    socket.addEventListener("close", () => this.lose(socket));
  }

  deliver(message) {
    if (message.type === "error") this.handlers.error(message.problem);
    else this.handlers[message.type]?.(message);
  }

  // Gives a socket up, also one whose end would take minutes to be noticed, and sets the next attempt.
  lose(socket) {
    if (this.socket !== socket) return;
    this.socket = null;
    socket.close();
    // Jitter: many pages must not come back in the same instant.
    const wait = this.wait * (0.75 + 0.5 * Math.random());
    this.handlers.closed(wait, this.refusal);
    if (this.wait === FIRST_WAIT_S || this.refusal) this.askWhy();
    this.timer = setTimeout(() => this.connect(), wait * 1000);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_S);
  }

  // A browser does not tell why a socket was refused; the same path without a socket is refused with the reason.
  async askWhy() {
    try {
      await request("GET", "v1/live");
    } catch (problem) {
      const refused = problem.status === 401 || problem.status === 403;
      if (!this.open && refused !== Boolean(this.refusal)) this.handlers.refused(refused ? problem : null);
      this.refusal = refused ? problem : null;
    }
  }

  // Does not wait any longer if there is no link.
  retry() {
    if (this.socket) return;
    this.wait = FIRST_WAIT_S;
    this.connect();
  }

  // Notices a socket that looks open but is dead (a phone that changed its network), and one that hangs while opening.
  async watch() {
    const { socket } = this;
    if (!socket || this.asking || performance.now() - this.heard < SILENCE_MS) return;
    if (!this.open) {
      this.lose(socket);
      return;
    }
    this.asking = true;
    try {
      const state = await request("GET", "v1/state");
      this.heard = performance.now();
      this.handlers.state(state);
    } catch {
      this.lose(socket);
    } finally {
      this.asking = false;
    }
  }

  get open() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  // Whether the message could be sent.
  send(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  // Everything off, both ways at once: either one alone is enough. The state afterwards; throws the last problem.
  async stop() {
    this.send({ type: "stop" });
    for (let left = STOP_TRIES; ; left -= 1) {
      try {
        return await request("POST", "v1/stop");
      } catch (problem) {
        if (left <= 1) throw problem;
      }
    }
  }
}
