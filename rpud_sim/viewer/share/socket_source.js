// @ts-check
/* Source of a live or recorded screen: frames and requests over one WebSocket. */
import { decode } from "./frames.js";

const [FIRST_WAIT, LONGEST_WAIT] = [250, 2000]; // before the page connects again [ms]

/** Connection to the server; when that has gone it connects again, for as long as the page is open. */
export class SocketSource {
  /** @param {(frame: import("./frames.js").Frame) => void} onFrame
   * @param {(open: boolean, reason: string) => void} onState called when the connection opens or closes */
  constructor(onFrame, onState) {
    this.onFrame = onFrame;
    this.onState = onState;
    this.wait = FIRST_WAIT;
    this.ended = false; // by an error of the server's
    this.connect();
  }

  connect() {
    const socket = new WebSocket(new URL(`frames${location.search}`, location.href.replace(/^http/, "ws")));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.wait = FIRST_WAIT;
      this.onState(true, "");
    };
    socket.onmessage = (event) => {
      const frame = decode(event.data);
      this.ended ||= frame.error !== undefined;
      this.onFrame(frame);
    };
    socket.onclose = (event) => {
      if (this.ended) return;
      this.onState(false, event.reason);
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
    this.socket = socket;
  }

  /** Send a request; without a connection it is lost, and the page says so. @param {Record<string, any>} request */
  send(request) { if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request)); }
}
