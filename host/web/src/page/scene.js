// The six cables and the force at the tip, seen from any side.

import { COLORS, fit } from "./curves.js";

// Length of an arrow, m per N: 2.5 N are 10 cm.
const ARROW_M_PER_N = 0.04;

export class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = -0.7;
    this.tilt = 0.45;
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons === 0) return;
      this.turn += event.movementX * 0.01;
      this.tilt = Math.min(1.5, Math.max(-1.5, this.tilt + event.movementY * 0.01));
      this.draw();
    });
  }

  // `telemetry`: null where there is none that is of now.
  show(rig, telemetry) {
    this.rig = rig;
    this.telemetry = telemetry;
  }

  // What of it is known now, in words for a reader who does not see the picture, too.
  get unknown() {
    if (!this.telemetry) return "no data";
    if (!this.telemetry.tip_m) return "tip not known";
    return this.telemetry.force_n ? "" : "force not known";
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    const { rig, telemetry } = this;
    if (!rig) return;
    const points = [rig.center_m, ...rig.units.map((unit) => unit.exit_m)];
    const middle = [0, 1, 2].map((i) => points.reduce((sum, p) => sum + p[i], 0) / points.length);
    const reach = Math.max(...points.map((p) => Math.hypot(...p.map((v, i) => v - middle[i]))));
    const scale = (0.46 * Math.min(width, height)) / reach;
    const [ct, st] = [Math.cos(this.turn), Math.sin(this.turn)];
    const [cl, sl] = [Math.cos(this.tilt), Math.sin(this.tilt)];
    // z up; seen from the side and from above.
    const at = (p) => {
      const [x, y, z] = p.map((v, i) => v - middle[i]);
      const across = ct * x + st * y;
      const away = -st * x + ct * y;
      return [width / 2 + scale * across, height / 2 - scale * (cl * z + sl * away)];
    };
    const line = (from, to, color, thick) => {
      context.strokeStyle = color;
      context.lineWidth = thick;
      context.beginPath();
      context.moveTo(...at(from));
      context.lineTo(...at(to));
      context.stroke();
    };
    // Without a place of the tip nothing ends there: a picture of the middle would pass for one.
    const tip = telemetry?.tip_m ?? null;
    const unknown = this.unknown;
    this.canvas.dataset.unknown = unknown;
    context.strokeStyle = "#2c3640";
    context.lineWidth = 1;
    context.beginPath();
    context.arc(...at(rig.center_m), scale * rig.radius_m, 0, 2 * Math.PI);
    context.stroke();
    context.font = "bold 14px system-ui";
    rig.units.forEach((unit, i) => {
      const tension = telemetry?.tension_n[i] ?? 0;
      if (tip) line(unit.exit_m, tip, COLORS[i], 1 + Math.max(0, tension));
      const [x, y] = at(unit.exit_m);
      context.fillStyle = COLORS[i];
      context.fillText(`${i + 1}`, x + 5, y - 5);
    });
    ["x", "y", "z"].forEach((name, i) => {
      const end = rig.center_m.map((v, k) => v + (k === i ? 0.05 : 0));
      line(rig.center_m, end, "#9aa7b2", 1);
      context.fillStyle = "#9aa7b2";
      context.fillText(name, ...at(end));
    });
    if (unknown) {
      context.fillStyle = "#ff5c5c";
      context.font = "bold 22px system-ui";
      context.fillText(unknown, 12, 28);
    }
    if (!tip) return;
    if (telemetry.force_n) {
      const end = tip.map((v, i) => v + ARROW_M_PER_N * telemetry.force_n[i]);
      line(tip, end, "#ffffff", 5);
      const [[x0, y0], [x1, y1]] = [at(tip), at(end)];
      const angle = Math.atan2(y1 - y0, x1 - x0);
      if (Math.hypot(x1 - x0, y1 - y0) > 4) {
        context.fillStyle = "#ffffff";
        context.beginPath();
        context.moveTo(x1 + 12 * Math.cos(angle), y1 + 12 * Math.sin(angle));
        context.lineTo(x1 + 9 * Math.cos(angle + 2.2), y1 + 9 * Math.sin(angle + 2.2));
        context.lineTo(x1 + 9 * Math.cos(angle - 2.2), y1 + 9 * Math.sin(angle - 2.2));
        context.fill();
      }
    }
    context.fillStyle = "#ffffff";
    context.beginPath();
    context.arc(...at(tip), 5, 0, 2 * Math.PI);
    context.fill();
  }
}
