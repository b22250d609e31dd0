// The WebSocket to the viewer: reconnects by itself, and puts the bands of pictures together.

const HEADER = 56; // bytes; as in protocol.py

export class Connection {
  // `handlers` has a function for each type of message, and `picture`, `open` and `closed`.
  constructor(handlers) {
    this.handlers = handlers;
    this.wait = 250; // ms before the next attempt
    this.open();
  }

  open() {
    const address = new URL("socket", location.href);
    address.protocol = "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.wait = 250;
      this.handlers.open();
    };
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.text(data) : this.band(data));
    this.socket.onclose = () => {
      this.handlers.closed();
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, 4000);
    };
  }

  send(type, fields = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type, ...fields }));
  }

  text(data) {
    const message = JSON.parse(data);
    this.handlers[message.type]?.(message);
  }

  band(data) {
    const view = new DataView(data);
    const word = (i) => view.getUint32(4 * i, true);
    const [number, viewNumber, left, top, across, down, width, height, first, rows] = Array.from({ length: 10 }, (_, i) => word(i));
    if (!this.picture || this.picture.number !== number) {
      this.picture = { number, view: viewNumber, window: [left, top, across, down], width, height, pixels: new Uint16Array(3 * width * height) };
      this.picture.limits = word(10) ? [view.getFloat32(44, true), view.getFloat32(48, true)] : null;
    }
    this.picture.pixels.set(new Uint16Array(data, HEADER), 3 * width * first);
    if (first + rows < height) return;
    const whole = this.picture;
    this.picture = null;
    this.handlers.picture(whole);
    this.send("received", { picture: number });
  }
}
