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
      if (this.ended) return;
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
    const band = bandOf(data);
    if (this.picture?.number !== band.number)
      this.picture = { ...band, pixels: new Uint16Array(3 * band.width * band.height) };
    this.picture.pixels.set(band.pixels, 3 * band.width * band.first);
    if (band.first + band.rows < band.height) return;
    const whole = this.picture;
    this.picture = null;
    this.handlers.picture(whole);
    this.send("received", { picture: whole.number });
  }
}

// The rows of a picture that a binary message has.
export function bandOf(data) {
  const head = new DataView(data);
  const words = Array.from({ length: 11 }, (_, i) => head.getUint32(4 * i, true));
  const [number, view, left, top, across, down, width, height, first, rows, limited] = words;
  const limits = limited ? [head.getFloat32(44, true), head.getFloat32(48, true)] : null;
  return {
    number,
    view,
    window: [left, top, across, down],
    width,
    height,
    first,
    rows,
    limits,
    pixels: new Uint16Array(data, HEADER),
  };
}
