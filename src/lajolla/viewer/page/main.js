// The page: joins the connection, the display, the camera and the panels.

import { Camera, control } from "./camera.js";
import { compareWithReference } from "./compare.js";
import { Connection } from "./connection.js";
import { Display } from "./display.js";
import { Panels } from "./panels.js";

const element = (id) => document.getElementById(id);
const canvas = element("canvas");
const notice = element("notice");
const say = (text, problem = false) => {
  notice.textContent = text;
  notice.classList.toggle("problem", problem);
};

let display;
try {
  display = new Display(canvas, say);
} catch (problem) {
  say(problem.message, true);
  throw problem;
}
const camera = new Camera();
let view = null; // the last message "viewed"
const homes = new Map(); // the first placement of each sensor
let shownView = -1;
let moved = false; // the camera, since it was sent
let movedAt = -Infinity; // when it moved last: what the viewer says of it then is old

const connection = new Connection({
  open: () => say("Opening the scene …"),
  closed: () =>
    say("The viewer does not answer. It may have been ended; this page connects again by itself.", true),
  hello: (message) => {
    const { file, reference } = message;
    element("title").textContent = file;
    panels.hello(message);
    if (message.fixed) document.body.classList.add("fixed");
    document.title = `${file} – lajolla`;
    if (reference) compareWithReference(display).then(() => panels.compare("split"));
  },
  opened: (message) => {
    if (message.distance && movedAt < 0) camera.distance = message.distance;
    panels.opened(message);
    say("");
  },
  viewed: (message) => {
    if (view && view.camera !== message.camera) movedAt = -Infinity; // another sensor
    view = message;
    display.film = [message.film.width, message.film.height];
    if (!camera.matrix || performance.now() - movedAt > 700) adopt();
    panels.viewed(message);
  },
  picture: (picture) => {
    if (shownView < 0) say("");
    shownView = picture.view;
    display.set("picture", picture);
    if (moved) sendCamera();
  },
  progress: (message) => panels.progress(message),
  inspected: (message) => {
    if (message.distance) camera.distance = message.distance; // what was clicked is what the camera turns about
    panels.inspected(message);
  },
  objects: (message) => panels.objects.list(message),
  parameters: (message) => panels.objects.parameters(message),
  noticed: ({ message }) => say(message),
  refused: ({ message }) => say(message, true),
  failed: ({ message }) => say(message, true),
  ended: ({ message }) => {
    connection.ended = true;
    say(message);
  },
});

const isFixed = () => document.body.classList.contains("fixed"); // nothing can be changed

const panels = new Panels(connection, display, { say, home: goHome });

// The placement of the camera that the viewer has.
function adopt() {
  const matrix = view.sensor.to_world;
  if (!matrix || isFixed()) return;
  if (!homes.has(view.camera)) {
    homes.set(view.camera, matrix);
    camera.open(matrix);
  } else camera.matrix = matrix;
}

let sent = -1; // the view that was shown when the camera was sent last
let sentAt = 0;
function sendCamera() {
  // One placement at a time: the next one is sent when its picture is there, or late.
  if (sent === shownView && performance.now() - sentAt < 200) return;
  moved = false;
  sent = shownView;
  sentAt = performance.now();
  connection.send("edit", { values: { "sensor.to_world": camera.matrix } });
}

let corner = null; // where a crop window begins

control(canvas, camera, {
  pressed: (event) => {
    corner = panels.mode === "crop" ? display.pixelAt(event.clientX, event.clientY) : null;
  },
  dragged: () => corner !== null,
  moved: () => {
    moved = true;
    movedAt = performance.now();
    say("");
    sendCamera();
  },
  released: (event, click) => {
    const at = display.pixelAt(event.clientX, event.clientY);
    if (corner) panels.crop(corner, at);
    else if (click) panels.clicked(Math.floor(at[0]), Math.floor(at[1]));
    corner = null;
  },
  magnify: (factor, x, y) => display.magnify(factor, x, y),
});

function goHome() {
  const home = homes.get(view?.camera);
  if (!home) return;
  camera.matrix = home;
  moved = true;
  sendCamera();
}

window.lajolla = { display, camera, connection, panels }; // for tests and the console
