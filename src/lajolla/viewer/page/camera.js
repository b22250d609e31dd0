// Moves the camera: mouse, touch and keys. A placement is a matrix of rows, as in scenes; its columns are the
// camera's left, up and forward directions and its position.

const column = (m, i) => [m[0][i], m[1][i], m[2][i]];
const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const normalized = (a) => a.map((x) => x / length(a));

function rotated(v, axis, angle) {
  // Rodrigues
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const turned = add(
    v.map((x) => x * c),
    cross(axis, v),
    s,
  );
  return add(turned, axis, dot(axis, v) * (1 - c));
}

const matrix = (left, up, forward, origin) =>
  [0, 1, 2].map((i) => [left[i], up[i], forward[i], origin[i]]).concat([[0, 0, 0, 1]]);

export class Camera {
  constructor() {
    this.distance = 1; // of the point that it turns about
    this.up = [0, 1, 0]; // the axis that is vertical
  }

  // Takes the placement of a scene that is opened.
  open(toWorld) {
    this.matrix = toWorld;
    const up = normalized(column(toWorld, 1));
    const strongest = up.reduce((best, x, i) => (Math.abs(x) > Math.abs(up[best]) ? i : best), 0);
    this.up = [0, 1, 2].map((i) => (i === strongest ? Math.sign(up[i]) : 0));
  }

  get position() {
    return column(this.matrix, 3);
  }
  get forward() {
    return normalized(column(this.matrix, 2));
  }
  get pivot() {
    return add(this.position, this.forward, this.distance);
  }

  turn(axis, angle, about) {
    const m = this.matrix;
    const directions = [0, 1, 2].map((i) => rotated(column(m, i), axis, angle));
    this.matrix = matrix(...directions, add(about, rotated(add(this.position, about, -1), axis, angle)));
  }

  // Angles in radians, to the right and downwards as the pointer moves.
  orbit(right, down) {
    const about = this.pivot;
    this.turn(this.up, -right, about);
    this.turn(normalized(column(this.matrix, 0)), down, about);
  }

  look(right, down) {
    this.turn(this.up, -right, this.position);
    this.turn(normalized(column(this.matrix, 0)), down, this.position);
  }

  roll(angle) {
    this.turn(this.forward, angle, this.position);
  }

  // To the left, up and forward, in units of the distance.
  move(left, up, forward) {
    const steps = [left, up, forward];
    const to = steps.reduce(
      (p, s, i) => add(p, normalized(column(this.matrix, i)), s * this.distance),
      this.position,
    );
    this.matrix = matrix(column(this.matrix, 0), column(this.matrix, 1), column(this.matrix, 2), to);
  }

  dolly(factor) {
    this.move(0, 0, 1 - factor);
    this.distance *= factor;
  }
}

const STEP = 0.02; // of a key that is pressed; held ones go on with 1 per second
const KEYS = {
  KeyW: (c, s) => c.move(0, 0, s),
  KeyS: (c, s) => c.move(0, 0, -s),
  KeyA: (c, s) => c.move(s, 0, 0),
  KeyD: (c, s) => c.move(-s, 0, 0),
  KeyR: (c, s) => c.move(0, s, 0),
  KeyF: (c, s) => c.move(0, -s, 0),
  KeyQ: (c, s) => c.roll(-s),
  KeyE: (c, s) => c.roll(s),
  ArrowLeft: (c, s) => c.orbit(-s, 0),
  ArrowRight: (c, s) => c.orbit(s, 0),
  ArrowUp: (c, s) => c.orbit(0, -s),
  ArrowDown: (c, s) => c.orbit(0, s),
};

// Lets pointers and keys on the canvas move the camera. `actions` has moved() after a move, clicked(event),
// dragged(event) for other uses of a drag, which returns whether it is one, and magnify(factor, x, y).
export function control(canvas, camera, actions) {
  const pointers = new Map();
  let travelled = 0;
  const radians = (pixels) => (Math.PI * pixels) / Math.max(canvas.clientHeight, 1);

  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true, focusVisible: false });
    pointers.set(event.pointerId, event);
    travelled = pointers.size > 1 ? Infinity : 0;
    actions.pressed(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.clientX, event.clientY - before.clientY];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled > 4 && !actions.dragged(event) && camera.matrix) {
      if (pointers.size === 2) pinch(event, before, dx, dy);
      else if (pointers.size === 1) drag(event, dx, dy);
      actions.moved();
    }
    pointers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => {
      if (pointers.delete(event.pointerId) && end === "pointerup") actions.released(event, travelled <= 4);
    });

  function drag(event, dx, dy) {
    const scale = (2 * Math.tan(Math.PI / 8)) / Math.max(canvas.clientHeight, 1);
    if (event.shiftKey || event.buttons & 4) camera.move(dx * scale, dy * scale, 0);
    else if (event.buttons & 2) camera.look(radians(dx) / 2, radians(dy) / 2);
    else if (event.altKey) camera.roll(radians(dx));
    else camera.orbit(radians(dx), radians(dy));
  }

  function pinch(event, before, dx, dy) {
    // two fingers: towards, and sideways
    const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    const gap = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
    if (gap(event) > 1) camera.dolly(Math.min(Math.max(gap(before) / gap(event), 0.5), 2));
    const scale = 0.4 / Math.max(canvas.clientHeight, 1);
    camera.move(dx * scale, dy * scale, 0);
  }

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const factor = Math.exp((event.deltaMode === 1 ? 0.05 : 0.0015) * event.deltaY);
      if (event.ctrlKey) return actions.magnify(1 / factor, event.clientX, event.clientY);
      if (!camera.matrix) return undefined;
      camera.dolly(factor);
      return actions.moved();
    },
    { passive: false },
  );

  const held = new Set();
  canvas.addEventListener("keydown", (event) => {
    if (!(event.code in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    if (event.repeat || !camera.matrix) return;
    KEYS[event.code](camera, STEP); // at once, however short it is pressed
    actions.moved();
    held.add(event.code);
    if (held.size > 1) return;
    last = performance.now();
    requestAnimationFrame(step);
  });
  canvas.addEventListener("keyup", (event) => held.delete(event.code));
  canvas.addEventListener("blur", () => held.clear());

  let last = 0;
  function step(now) {
    const seconds = Math.min(Math.max(now - last, 0) / 1000, 0.1);
    last = now;
    for (const code of held) KEYS[code](camera, seconds);
    if (held.size === 0) return;
    actions.moved();
    requestAnimationFrame(step);
  }
}
