// The panels beside the picture: display, render, pixel, camera, comparison and warnings.

import { compareWithFile } from "./compare.js";
import { duration, element, list, made, percent, rounded, short } from "./elements.js";
import { Objects } from "./objects.js";

export class Panels {
  constructor(connection, display, page) {
    Object.assign(this, {
      connection,
      display,
      page,
      mode: null,
      layers: {},
      objects: new Objects(connection),
    });
    this.onDisplay();
    this.onRender();
    this.onCamera();
    this.onCompare();
    this.onSave();
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
      this.connection.send("show", { layer: target.value });
    });
    element("copy").addEventListener("click", () =>
      navigator.clipboard.writeText(element("replay").textContent),
    );
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
      const link = made("a", "", {
        href: URL.createObjectURL(await display.png()),
        download: `${element("title").textContent.replace(/\.xml$/, "")}.png`,
      });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  }

  onRender() {
    element("limit").addEventListener("change", ({ target }) => {
      this.connection.send("limit", {
        samples: target.value ? Math.max(1, Math.round(Number(target.value))) : null,
      });
    });
    element("pause").addEventListener("click", () => this.connection.send(this.paused ? "resume" : "pause"));
    element("integrator").addEventListener("change", ({ target }) =>
      this.connection.send("choose", { integrator: target.value }),
    );
    element("crop").addEventListener("click", () => this.choose("crop"));
    element("whole").addEventListener("click", () => this.connection.send("crop", { window: null }));
  }

  onSave() {
    element("save-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.connection.send("save", { name: element("save-name").value });
    });
  }

  onCamera() {
    element("sensor").addEventListener("change", ({ target }) =>
      this.connection.send("look", { sensor: target.value }),
    );
    element("home").addEventListener("click", () => this.page.home());
    element("focus").addEventListener("click", () => this.choose("focus"));
  }

  compare(mode) {
    if (mode !== "off" && !this.display.pictures.other)
      this.page.say("There is no other picture to compare with yet.");
    element("compare").value = mode;
    element("split").hidden = mode !== "split";
    this.display.update({ comparison: mode });
  }

  onCompare() {
    const { display } = this;
    element("compare").addEventListener("change", ({ target }) => this.compare(target.value));
    element("compare-file").addEventListener("change", async ({ target }) => {
      if (!target.files.length) return;
      try {
        await compareWithFile(display, target.files[0]);
        this.compare("split");
      } catch {
        this.page.say(`The browser cannot read ${target.files[0].name}.`, true);
      }
    });
    element("split").addEventListener("input", ({ target }) =>
      display.update({ split: Number(target.value) }),
    );
    element("keep").addEventListener("click", () => {
      const { picture } = display.pictures;
      if (!picture) return;
      display.set("other", { ...picture, texture: undefined });
      this.compare("split");
    });
  }

  // What the next click or drag is for.
  choose(mode) {
    this.mode = this.mode === mode ? null : mode;
    for (const name of ["crop", "focus"])
      element(name).setAttribute("aria-pressed", String(this.mode === name));
    element("canvas").classList.toggle("pick", this.mode !== null);
  }

  clicked(x, y) {
    const [width, height] = this.display.film;
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    this.connection.send(this.mode === "focus" ? "focus" : "inspect", { x, y });
    if (this.mode === "focus") this.choose("focus");
  }

  crop(from, to) {
    const clamped = [from, to].map((point) =>
      point.map((x, i) => Math.round(Math.min(Math.max(x, 0), this.display.film[i]))),
    );
    const [left, top] = [0, 1].map((i) => Math.min(clamped[0][i], clamped[1][i]));
    const [width, height] = [0, 1].map((i) => Math.abs(clamped[0][i] - clamped[1][i]));
    this.choose("crop");
    if (width > 0 && height > 0) this.connection.send("crop", { window: [left, top, width, height] });
  }

  hello({ file, folder }) {
    if (!element("save-name").value)
      element("save-name").value = `${file.replace(/\.xml$/i, "")}-edited.xml`;
    element("save-folder").textContent = folder === "." ? "the current folder" : folder;
  }

  opened({ layers, warnings, layer, integrators, sensors }) {
    this.layers = layers;
    const options = ["", ...Object.keys(layers)].map((name) =>
      made("option", name || "picture", { value: name }),
    );
    element("layer").replaceChildren(...options);
    element("layer").value = layer ?? "";
    element("warnings-section").hidden = warnings.length === 0;
    element("warning-count").textContent = `(${warnings.length})`;
    element("warnings").replaceChildren(...warnings.map((text) => made("pre", text)));
    element("integrator").replaceChildren(
      ...integrators.map((name) => made("option", name, { value: name })),
    );
    element("integrator").value = this.integrator;
    element("sensor-choice").hidden = sensors.length < 2;
    element("sensor").replaceChildren(...sensors.map((name) => made("option", name, { value: name })));
    element("sensor").value = this.sensor;
  }

  viewed({ integrator, camera }) {
    this.integrator = integrator;
    this.sensor = camera;
    element("integrator").value = integrator;
    element("sensor").value = camera;
    for (const [object, place] of [
      ["sensor", "camera-fields"],
      ["integrator", "integrator-fields"],
    ])
      if (!element(place).contains(document.activeElement)) this.objects.show(object, element(place));
  }

  progress(message) {
    this.last = message;
    this.paused = message.state === "paused";
    element("pause").textContent = this.paused ? "Go on" : "Pause";
    const known = message.seconds_left !== null && message.seconds_left < 1e7;
    const words = {
      rendering: `rendering${known ? `, ${duration(message.seconds_left)} left` : ""}`,
      finished: "finished",
      paused: "paused",
    };
    element("status").textContent = words[message.state];
    element("bar").value = message.state === "finished" ? 1 : message.fraction;
    list("numbers", [
      ["samples", `${rounded(message.samples)}${message.limit ? ` of ${message.limit}` : ""} per pixel`],
      ["speed", short(message.samples_per_second, "samples/s")],
      ["rays", short(message.rays_per_second, "rays/s")],
      ["error estimate", message.noise === null ? "from 16 samples on" : percent(message.noise)],
      ["time", duration(message.seconds)],
      ["not finite", message.nonfinite ? `${message.nonfinite} samples, which count as black` : ""],
    ]);
  }

  inspected(message) {
    element("pixel-hint").hidden = true;
    const { x, y, inside, value, channels, samples, error, shape, place, material, model, material_place } =
      message;
    list("pixel", [
      ["position", `${x}, ${y}${inside ? "" : " (is not rendered)"}`],
      ["red, green, blue", value?.map((c) => rounded(c)).join("  ")],
      ...Object.entries(channels ?? {}).map(([name, number]) => [name, rounded(number)]),
      ["samples", samples],
      ["error near it", error === null || error === undefined ? "" : percent(error)],
      ["distance", message.distance ? rounded(message.distance) : ""],
      ["shape", shape === null ? "none" : shape && `${shape}${place ? ` (${place})` : ""}`],
      ["material", material && `${material}, ${model}${material_place ? ` (${material_place})` : ""}`],
    ]);
    element("replay").textContent = message.command;
    element("replay").hidden = element("copy").hidden = !inside;
  }
}
