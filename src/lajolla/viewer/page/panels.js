// The panels beside the picture: display, render, pixel, camera, objects, comparison and warnings.

const element = (id) => document.getElementById(id);

function made(tag, text = "", attributes = {}) {
  const result = Object.assign(document.createElement(tag), attributes);
  if (text !== "") result.textContent = text;
  return result;
}

function list(id, rows) {
  element(id).replaceChildren(...rows.flatMap(([name, value]) => [made("dt", name), made("dd", value)]));
}

function short(number, unit = "") {
  if (number === null || number === undefined) return "unknown";
  const [divisor, prefix] = number >= 1e9 ? [1e9, "G"] : number >= 1e6 ? [1e6, "M"] : number >= 1e3 && unit ? [1e3, "k"] : [1, ""];
  return `${Number((number / divisor).toPrecision(3))} ${prefix}${unit}`.trim();
}

function duration(seconds) {
  if (seconds === null) return "unknown";
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  return whole < 3600 ? `${Math.floor(whole / 60)} min ${whole % 60} s` : `${Math.floor(whole / 3600)} h ${Math.floor(whole / 60) % 60} min`;
}

export class Panels {
  constructor(connection, display, page) {
    Object.assign(this, { connection, display, page, mode: null, layers: {} });
    this.onDisplay();
    this.onRender();
    this.onCamera();
    this.onCompare();
  }

  onDisplay() {
    const { display } = this;
    element("exposure").addEventListener("input", ({ target }) => {
      element("exposure-value").textContent = Number(target.value).toFixed(1).replace(/\.0$/, "");
      display.update({ exposure: Number(target.value) });
    });
    element("curve").addEventListener("change", ({ target }) => display.update({ curve: target.value }));
    element("layer").addEventListener("change", ({ target }) => {
      element("layer-hint").textContent = this.layers[target.value] ?? "";
      this.connection.send("layer", { name: target.value });
    });
    element("fit").addEventListener("click", () => {
      display.zoom = null;
      display.draw();
    });
    element("actual").addEventListener("click", () => {
      [display.zoom, display.centre] = [1, [0.5, 0.5]];
      display.draw();
    });
    element("save-exr").href = new URL("picture.exr", location.href);
    element("save-png").addEventListener("click", async () => {
      const link = made("a", "", { href: URL.createObjectURL(await display.png()), download: `${element("title").textContent.replace(/\.xml$/, "")}.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  }

  onRender() {
    element("limit").addEventListener("change", ({ target }) => {
      this.connection.send("samples", { limit: target.value ? Math.round(Number(target.value)) : null });
    });
    element("pause").addEventListener("click", () => this.connection.send(this.paused ? "resume" : "pause"));
    element("integrator").addEventListener("change", ({ target }) => this.connection.send("integrator", { name: target.value }));
    element("crop").addEventListener("click", () => this.choose("crop"));
    element("whole").addEventListener("click", () => this.connection.send("crop", { window: null }));
  }

  onCamera() {
    element("home").addEventListener("click", () => this.page.home());
    element("focus").addEventListener("click", () => this.choose("focus"));
  }

  onCompare() {
    const { display } = this;
    const set = (mode) => {
      element("compare").value = mode;
      element("split").hidden = mode !== "split";
      display.update({ comparison: mode });
    };
    element("compare").addEventListener("change", ({ target }) => set(target.value));
    element("split").addEventListener("input", ({ target }) => display.update({ split: Number(target.value) }));
    element("keep").addEventListener("click", () => {
      const { picture } = display.pictures;
      if (!picture) return;
      display.set("other", { ...picture, texture: undefined });
      set("split");
    });
  }

  // What the next click or drag is for.
  choose(mode) {
    this.mode = this.mode === mode ? null : mode;
    for (const name of ["crop", "focus"]) element(name).setAttribute("aria-pressed", String(this.mode === name));
    element("canvas").classList.toggle("pick", this.mode !== null);
  }

  clicked(x, y) {
    const [width, height] = this.display.film;
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    this.connection.send(this.mode === "focus" ? "focus" : "inspect", { x, y });
    if (this.mode === "focus") this.choose("focus");
  }

  crop(from, to) {
    const clamped = [from, to].map((point) => point.map((x, i) => Math.round(Math.min(Math.max(x, 0), this.display.film[i]))));
    const [left, top] = [0, 1].map((i) => Math.min(clamped[0][i], clamped[1][i]));
    const [width, height] = [0, 1].map((i) => Math.abs(clamped[0][i] - clamped[1][i]));
    this.choose("crop");
    if (width > 0 && height > 0) this.connection.send("crop", { window: [left, top, width, height] });
  }

  opened({ layers, warnings, layer, integrators }) {
    this.layers = layers;
    const options = ["", ...Object.keys(layers)].map((name) => made("option", name || "picture", { value: name }));
    element("layer").replaceChildren(...options);
    element("layer").value = layer ?? "";
    element("warnings-section").hidden = warnings.length === 0;
    element("warning-count").textContent = `(${warnings.length})`;
    element("warnings").replaceChildren(...warnings.map((text) => made("pre", text)));
    if (integrators) element("integrator").replaceChildren(...integrators.map((name) => made("option", name, { value: name })));
  }

  viewed(message) {
    element("integrator").value = message.integrator.type;
  }

  shown() {}

  progress(message) {
    this.paused = message.state === "paused";
    element("pause").textContent = this.paused ? "Go on" : "Pause";
    const left = message.seconds_left === null ? "" : `, ${duration(message.seconds_left)} left`;
    const words = { rendering: `rendering${left}`, finished: "finished", paused: "paused" };
    element("status").textContent = words[message.state];
    const done = message.state === "finished" ? 1 : message.seconds_left === null ? 0 : message.seconds / (message.seconds + message.seconds_left);
    element("bar").value = done;
    list("numbers", [
      ["samples", `${Number(message.samples.toFixed(1))}${message.limit ? ` of ${message.limit}` : ""} per pixel`],
      ["speed", short(message.samples_per_second, "samples/s")],
      ["rays", short(message.rays_per_second, "rays/s")],
      ["error estimate", message.noise === null ? "after 16 samples" : `${Number((100 * message.noise).toPrecision(2))} %`],
      ["time", duration(message.seconds)],
      ...(message.nonfinite ? [["not finite", `${message.nonfinite} samples`]] : []),
    ]);
  }

  inspected() {}

  parameters() {}
}
