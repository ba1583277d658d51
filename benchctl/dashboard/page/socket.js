// What a running campaign tells, as it comes: one websocket, opened anew when it is lost or falls silent.

import { campaignPath } from "./api.js";
import { connection, suspect } from "./connection.js";

const AGAIN_S = [0, 0.5, 1, 2, 4, 8];
const SILENT_S = 8;

/** Calls `tell(message)` for each one until the signal aborts; `watch(what)` says which channels are to be drawn. */
export class Feed {
  constructor(id, tell, signal) {
    Object.assign(this, { id, tell, signal, wanted: null, failures: 0, socket: null });
    signal.addEventListener("abort", () => this.leave());
    connection.addEventListener("back", () => this.again(), { signal });
    this.open();
  }

  /** Ask for other channels, another window or another width. */
  watch(wanted) {
    this.wanted = wanted;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ watch: wanted }));
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}${campaignPath(this.id, "/live")}`);
    this.socket = socket;
    this.listen();
    socket.addEventListener("open", () => this.wanted && this.watch(this.wanted));
    socket.addEventListener("message", ({ data }) => {
      if (socket !== this.socket) return;
      this.failures = 0;
      this.listen();
      this.tell(JSON.parse(data));
    });
    socket.addEventListener("close", () => socket === this.socket && this.lose());
  }

  /** A line that is cut somewhere may stay open for minutes without a word. */
  listen() {
    clearTimeout(this.silence);
    this.silence = setTimeout(() => this.lose(), 1000 * SILENT_S);
  }

  lose() {
    this.leave();
    if (!this.signal.aborted) suspect(); // asks the server itself; it tells `back`
  }

  again() {
    if (this.socket) return;
    clearTimeout(this.pause);
    this.pause = setTimeout(() => this.open(), 1000 * AGAIN_S[Math.min(this.failures, AGAIN_S.length - 1)]);
    this.failures += 1;
  }

  leave() {
    clearTimeout(this.silence);
    clearTimeout(this.pause);
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }
}
