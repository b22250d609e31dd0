// Pictures to compare with: the one that the viewer was given, or a file that the browser can read.

import { bandOf } from "./connection.js";

export async function compareWithReference(display) {
  const response = await fetch(new URL("reference", location.href));
  if (response.ok) display.set("other", bandOf(await response.arrayBuffer()));
}

// A file whose colours are sRGB.
export async function compareWithFile(display, file) {
  const bitmap = await createImageBitmap(file);
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0);
  const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
  const linear = Float32Array.from({ length: 256 }, (_, i) =>
    i <= 10 ? i / 255 / 12.92 : ((i / 255 + 0.055) / 1.055) ** 2.4,
  );
  const pixels = new Float32Array(3 * bitmap.width * bitmap.height);
  for (let from = 0, to = 0; from < data.length; from += 4)
    for (let channel = 0; channel < 3; ++channel) pixels[to++] = linear[data[from + channel]];
  display.set("other", {
    pixels,
    width: bitmap.width,
    height: bitmap.height,
    window: [0, 0, bitmap.width, bitmap.height],
    limits: null,
  });
}
