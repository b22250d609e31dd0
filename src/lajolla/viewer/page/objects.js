// The tree of the scene's objects, and fields for their parameters.

import { element, made, rounded } from "./elements.js";

const NUMBERS = ["float", "integer", "floats"];
const isNumber = (value) => typeof value === "number";

export class Objects {
  constructor(connection) {
    this.connection = connection;
    this.waiting = new Map(); // objects whose parameters are asked for, and where they will be shown
    this.open = new Set();
    element("search").addEventListener("input", () => this.ask());
    element("objects-section").addEventListener("toggle", () => this.ask());
  }

  ask() {
    if (element("objects-section").open) this.connection.send("objects", { search: element("search").value });
  }

  // Objects whose names are parts of another's, "ball.bsdf" of "ball", are inside it.
  list({ objects, count }) {
    const places = new Map();
    const top = document.createDocumentFragment();
    for (const { name, kind, model } of objects) {
      const parts = name.split(".");
      let parent = top;
      for (let end = parts.length - 1; end > 0 && parent === top; --end)
        parent = places.get(parts.slice(0, end).join(".")) ?? top;
      const details = made("details");
      const label = parent === top ? name : name.slice(parent.dataset.name.length + 1);
      const summary = made("summary", label);
      summary.append(made("span", ` ${model === kind ? kind : `${kind} ${model}`}`, { className: "hint" }));
      const fields = made("div", "", { className: "fields" });
      details.append(summary, fields);
      details.dataset.name = name;
      details.addEventListener("toggle", (event) => {
        if (event.target !== details) return;
        this.open[details.open ? "add" : "delete"](name);
        if (details.open) this.show(name, fields);
      });
      details.open = this.open.has(name);
      parent.append(details);
      places.set(name, details);
    }
    if (count > objects.length)
      top.append(made("p", `${count - objects.length} more; search for their names.`, { className: "hint" }));
    element("objects").replaceChildren(top);
  }

  // Asks for the parameters of an object, to be shown in an element.
  show(name, place) {
    this.waiting.set(name, [...(this.waiting.get(name) ?? []), place]);
    this.connection.send("parameters", { object: name });
  }

  parameters({ object, plugin, place, parameters }) {
    for (const target of this.waiting.get(object) ?? []) {
      const rows = parameters.map((parameter) => this.row(parameter));
      const origin = [plugin, place].filter(Boolean).join(", ");
      target.replaceChildren(made("p", origin, { className: "hint" }), ...rows);
    }
    this.waiting.delete(object);
  }

  row(parameter) {
    const row = made("div", "", { className: "field", title: describe(parameter) });
    const id = `parameter-${parameter.path}-${Math.random().toString(36).slice(2)}`;
    const label = made("span", parameter.name);
    if (parameter.value === null) row.append(label, made("span", parameter.summary, { className: "hint" }));
    else {
      label.id = id;
      const editor = this.editor(parameter);
      for (const input of editor.matches("input, select") ? [editor] : editor.querySelectorAll("input")) {
        input.setAttribute("aria-labelledby", id);
        input.dataset.path = parameter.path;
        input.disabled = document.body.classList.contains("fixed");
      }
      row.append(label, editor);
    }
    return row;
  }

  editor(parameter) {
    const { type, value, choices } = parameter;
    if (typeof value === "boolean") return this.checkbox(parameter);
    if (type === "choice" || choices.length) return this.select(parameter);
    if (Array.isArray(value) && Array.isArray(value[0])) return this.matrix(parameter);
    if (Array.isArray(value)) return this.vector(parameter);
    return isNumber(value) && (NUMBERS.includes(type) || type.startsWith("texture") || type === "spectrum")
      ? this.number(parameter)
      : this.text(parameter);
  }

  change(parameter, value) {
    this.connection.send("edit", { values: { [parameter.path]: value } });
  }

  checkbox(parameter) {
    const input = made("input", "", { type: "checkbox", checked: parameter.value });
    input.addEventListener("change", () => this.change(parameter, input.checked));
    return input;
  }

  select(parameter) {
    const select = made("select");
    select.append(...parameter.choices.map((choice) => made("option", choice, { value: choice })));
    select.value = parameter.value;
    select.addEventListener("change", () => this.change(parameter, select.value));
    return select;
  }

  number(parameter) {
    return this.numberInput(parameter, parameter.value, (value) => this.change(parameter, value));
  }

  // One number, with the range of its parameter; `changed` gets valid ones.
  numberInput(parameter, value, changed) {
    const input = made("input", "", { type: "number", step: "any", value: rounded(value, 7) });
    if (parameter.minimum !== null) input.min = parameter.minimum;
    if (parameter.maximum !== null) input.max = parameter.maximum;
    input.addEventListener("input", () => {
      const wrong = input.value === "" || !input.checkValidity();
      input.classList.toggle("wrong", wrong);
      if (!wrong)
        changed(parameter.type === "integer" ? Math.round(Number(input.value)) : Number(input.value));
    });
    return input;
  }

  vector(parameter) {
    const values = [...parameter.value];
    const row = made("div", "", { className: "vector" });
    const inputs = values.map((value, i) =>
      this.numberInput(parameter, value, (number) => {
        values[i] = number;
        if (picker) picker.value = hexadecimal(values);
        this.change(parameter, values);
      }),
    );
    const isColour =
      values.length === 3 && (parameter.type.includes("spectrum") || parameter.type === "spectrum");
    const picker = isColour ? made("input", "", { type: "color", value: hexadecimal(values) }) : null;
    picker?.addEventListener("input", () => {
      values.splice(0, 3, ...linear(picker.value));
      inputs.forEach((input, i) => (input.value = rounded(values[i], 4)));
      this.change(parameter, values);
    });
    row.append(...(picker ? [picker] : []), ...inputs);
    return row;
  }

  matrix(parameter) {
    const values = parameter.value.map((row) => [...row]);
    const block = made("div");
    values.forEach((numbers, i) => {
      const row = made("div", "", { className: "vector" });
      row.append(
        ...numbers.map((value, j) =>
          this.numberInput({ ...parameter, minimum: null, maximum: null }, value, (number) => {
            values[i][j] = number;
            this.change(parameter, values);
          }),
        ),
      );
      if (i < 3) block.append(row);
    });
    return block;
  }

  text(parameter) {
    const input = made("input", "", { type: "text", value: parameter.value });
    input.addEventListener("change", () =>
      this.change(parameter, isNumber(parameter.value) ? Number(input.value) : input.value),
    );
    return input;
  }
}

function describe({ doc, unit, minimum, maximum }) {
  const range = minimum === null && maximum === null ? "" : `${minimum ?? "…"} to ${maximum ?? "…"}`;
  return [doc, range, unit].filter(Boolean).join(", ");
}

// Colours are edited as sRGB; brighter ones than white are scaled to it in the picker alone.
function hexadecimal(colour) {
  const most = Math.max(1, ...colour);
  const encoded = colour
    .map((c) => Math.max(c, 0) / most)
    .map((c) => (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
  return `#${encoded
    .map((c) =>
      Math.round(255 * c)
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
}

function linear(text) {
  const encoded = [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16) / 255);
  return encoded.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
}
