// The page: shows telemetry, sends orders, stops.

import { Rpc } from "./rpc.js";
import { COLORS, Curves } from "./curves.js";
import { Scene } from "./scene.js";

const $ = (id) => document.getElementById(id);
// A picture that is older than this is not "now": the board reports 50 times a second.
const STALE_MS = 500;

const curves = new Curves($("curves"));
const scene = new Scene($("scene"));
let about = null;
let newest = null;
let newestAt = 0;
let recording = { on: false };
// STOP was pressed while there was no connection.
let stopWaits = false;

const text = (id, words) => {
  if ($(id).textContent !== words) $(id).textContent = words;
};
const newton = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));

function say(words, error = false) {
  text("said", words);
  $("said").classList.toggle("error", error);
}

function stopped(words, error = false) {
  text("stopped", words);
  $("stopped").classList.toggle("error", error);
}

// Telemetry goes on the screen at the screen's own pace; the newest counts.
function draw() {
  const fresh = newest !== null && rpc.connected && performance.now() - newestAt < STALE_MS;
  document.body.classList.toggle("stale", !fresh);
  if (fresh) show(newest);
  else {
    text("state", rpc.connected ? "no data" : "not connected");
    $("state").className = "state gone";
    text("force", "–");
    text("components", "");
    text("tip", "");
    text("who", "");
    [...$("units").tBodies[0].rows].forEach((row) => cells(row, ["–", "–", "–"]));
    faults([]);
    scene.show(about?.rig, null);
    scene.draw();
  }
  requestAnimationFrame(draw);
}

function show(now) {
  text("state", now.state);
  const kind = { ready: "ready", running: "driven", fault: "fault", "no status": "gone", "no link": "gone" };
  $("state").className = `state ${kind[now.state] ?? ""}`;
  text("who", now.commander ? `${now.commander} commands` : "nobody commands");
  const force = now.force_n;
  text("force", force ? Math.hypot(...force).toFixed(2) : "–");
  text("components", force ? ["x", "y", "z"].map((a, i) => `${a} ${newton(force[i])}`).join("   ") : "force not known");
  const tip = now.tip_m?.map((v) => (1000 * v).toFixed(1)).join(", ");
  text("tip", tip ? `tip at ${tip} mm` : "pose not known");
  [...$("units").tBodies[0].rows].forEach((row, i) => {
    cells(row, [newton(now.tension_n[i]), newton(now.setpoint_n[i]), unitState(now, i)]);
  });
  faults(now.faults);
  curves.draw();
  scene.show(about?.rig, now);
  scene.draw();
}

function cells(row, all) {
  all.forEach((words, k) => {
    if (row.cells[k + 1].textContent !== words) row.cells[k + 1].textContent = words;
  });
}

function unitState(now, i) {
  const zero = now.zeroed[i] === false ? ", no zero" : "";
  return (now.unit_state[i] ?? "not known") + zero;
}

let shownFaults = "";
function faults(list) {
  const key = JSON.stringify(list);
  if (key === shownFaults) return;
  shownFaults = key;
  const place = $("faults");
  place.hidden = list.length === 0;
  place.replaceChildren(
    ...list.flatMap(({ unit, code }) => {
      const known = about?.faults[code] ?? { name: `fault ${code}`, meaning: "", way_out: "" };
      const title = document.createElement("h2");
      title.textContent = `${unit === null ? "Board" : `Unit ${unit}`}: ${known.name} (fault ${code})`;
      const meaning = document.createElement("p");
      meaning.textContent = known.meaning;
      const wayOut = document.createElement("p");
      wayOut.textContent = known.way_out;
      return [title, meaning, wayOut];
    }),
  );
}

function event({ t_s, text: words }) {
  const item = document.createElement("li");
  item.textContent = `${t_s.toFixed(2)} s  ${words}`;
  $("events").prepend(item);
  while ($("events").children.length > 50) $("events").lastChild.remove();
}

const rpc = new Rpc({
  open() {
    if (stopWaits) stop();
  },
  lost() {
    newest = null;
  },
  notified(method, params) {
    if (method === "telemetry") {
      newest = params;
      newestAt = performance.now();
      curves.add(params);
    } else if (method === "event") event(params);
    else if (method === "welcome") {
      about = params;
      shownFaults = "";
      text("rig", params.rig?.name ?? params.name);
      text("link", params.link);
      document.title = `${params.name}: force rig`;
    } else if (method === "recording") {
      if (recording.on && !params.on) {
        const words = params.error ?? `${params.samples ?? "no"} samples in ${params.folder}`;
        say(words, params.error !== undefined);
      }
      recording = params;
      text("record", params.ending ? "Recording ends" : params.on ? "End recording" : "Record");
    } else if (method === "gone") stopped(params.why, true);
  },
});

function stop() {
  if (!rpc.connected) {
    stopWaits = true;
    stopped("NOT CONNECTED: nothing was stopped. Press the E-stop. Without setpoints the board goes to 0 V by itself.", true);
    return;
  }
  stopWaits = false;
  const began = performance.now();
  stopped("stopping");
  rpc.call("stop").then(
    () => stopped(`stopped: the board has confirmed 0 V after ${(performance.now() - began).toFixed(0)} ms`),
    (error) => stopped(`NOT CONFIRMED: ${error.message}. Press the E-stop.`, true),
  );
}

// When the finger comes down, and for keyboards a click; two stops are one.
$("stop").addEventListener("pointerdown", stop);
$("stop").addEventListener("click", (event) => {
  if (event.detail === 0) stop();
});

function order(id, words, call) {
  $(id).addEventListener("click", () => {
    say(words);
    call().then(
      (done) => say(done ?? "done"),
      (error) => say(error.message, true),
    );
  });
}

const number = (id) => {
  const value = $(id).valueAsNumber;
  if (Number.isNaN(value)) throw new Error(`${$(id).parentElement.textContent.trim()}: a number is missing`);
  return value;
};

order("set_force", "the force is being set", async () => {
  const force_n = ["fx", "fy", "fz"].map(number);
  const duration_s = number("seconds");
  await rpc.call("set_force", { force_n, duration_s });
  return `the force was held for ${duration_s} s`;
});
order("hold", "the tensions are being set", async () => {
  await rpc.call("hold", { ends_with_client: true });
  return "held until you disarm or leave this page";
});
order("disarm", "disarming", async () => {
  await rpc.call("disarm");
  return "disarmed: the motors are at 0 V";
});
order("clear", "clearing", async () => {
  const { fault } = await rpc.call("clear");
  if (fault) throw new Error(fault);
  stopped("");
  return "no fault is latched";
});
order("zero", "the zeros are measured: the cables must be slack", async () => {
  await rpc.call("zero");
  return "the zeros are measured";
});
order("record", "one moment", async () => {
  if (recording.on) {
    await rpc.call("end_recording");
    return "the recording ends";
  }
  const { folder } = await rpc.call("record");
  return `recording to ${folder}`;
});

COLORS.forEach((color, i) => {
  const row = $("units").tBodies[0].insertRow();
  const head = row.insertCell();
  const mark = document.createElement("span");
  mark.className = "mark";
  mark.style.background = color;
  head.append(mark, ` ${i + 1}`);
  for (let k = 0; k < 3; k++) row.insertCell().textContent = "–";
});
draw();
