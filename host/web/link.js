// The WebSocket to the daemon: tries again by itself, waiting longer each time.

const FIRST_WAIT_S = 1;
const LONGEST_WAIT_S = 8;

export class Link {
  // handlers: open(), closed(seconds), and one per message type: scene, state, plan, error.
  constructor(handlers) {
    this.handlers = handlers;
    this.wait = FIRST_WAIT_S;
    this.socket = null;
  }

  start() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/v1/live`);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.wait = FIRST_WAIT_S;
      this.handlers.open();
    });
    socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      if (message.type === "error") this.handlers.error(message.problem);
      else this.handlers[message.type]?.(message);
    });
    socket.addEventListener("close", () => {
      this.handlers.closed(this.wait);
      setTimeout(() => this.start(), this.wait * 1000);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT_S);
    });
  }

  // Whether the message could be sent.
  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
