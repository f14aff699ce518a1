// Tensions over the last seconds, setpoints dashed.

const SECONDS = 20;
export const COLORS = ["#ff8a5c", "#ffd23f", "#7bd389", "#4cc9f0", "#8c9eff", "#f29bd4"];

// Makes a canvas as sharp as the screen; its size in CSS pixels.
export function fit(canvas) {
  const scale = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

export class Curves {
  constructor(canvas) {
    this.canvas = canvas;
    this.rows = [];
  }

  add(telemetry) {
    const last = this.rows.at(-1);
    // The rig was started anew.
    if (last && telemetry.t_s < last.t_s) this.rows = [];
    this.rows.push(telemetry);
    while (this.rows[0].t_s < telemetry.t_s - SECONDS) this.rows.shift();
  }

  draw() {
    const { context, width, height } = fit(this.canvas);
    if (this.rows.length === 0) return;
    const end = this.rows.at(-1).t_s;
    const all = this.rows.flatMap((row) => [...row.tension_n, ...row.setpoint_n]);
    const most = Math.max(4, ...all.filter((value) => value !== null)) * 1.05;
    const x = (t) => 34 + ((width - 40) * (t - end + SECONDS)) / SECONDS;
    const y = (n) => height - 18 - ((height - 26) * Math.max(n, 0)) / most;
    context.font = "12px system-ui";
    context.fillStyle = "#9aa7b2";
    context.strokeStyle = "#2c3640";
    context.lineWidth = 1;
    const step = most > 10 ? 4 : most > 5 ? 2 : 1;
    for (let n = 0; n <= most; n += step) {
      context.beginPath();
      context.moveTo(x(end - SECONDS), y(n));
      context.lineTo(x(end), y(n));
      context.stroke();
      context.fillText(`${n} N`, 2, y(n) + 4);
    }
    context.fillText(`${SECONDS} s`, 36, height - 4);
    const line = (key, unit, dash, thick) => {
      context.setLineDash(dash);
      context.lineWidth = thick;
      context.beginPath();
      let open = false;
      for (const row of this.rows) {
        const value = row[key][unit];
        if (value === null) {
          open = false;
          continue;
        }
        if (open) context.lineTo(x(row.t_s), y(value));
        else context.moveTo(x(row.t_s), y(value));
        open = true;
      }
      context.stroke();
    };
    COLORS.forEach((color, unit) => {
      context.strokeStyle = color;
      line("setpoint_n", unit, [4, 4], 1);
      line("tension_n", unit, [], 2);
    });
    context.setLineDash([]);
  }
}
