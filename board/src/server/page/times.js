// Duration of each stage, compared with its budget: a bar, a curve of the last frames, and the share of frames over the budget.

import { curves, duration, element, figures, milliseconds, niceAbove } from "./figures.js";

/** Number of frames in the curves of durations, and shortest time between two drawings, ms. */
const KEPT = 300, PAUSE = 150;

/** Part of a bar's width that represents the budget. */
const FULL = 0.8;

const STAGES = [
  ["capture", "capture", "waiting for the burst included", "#8a94a8"], ["front", "merge, map", "", "#4c9be8"], ["pyramid", "pyramid", "", "#7a6ff0"],
  ["sample", "sampler", "without its filter", "#e8a33d"], ["filter", "filter", "over time, of the sampler", "#d95f8c"], ["encode", "encoding", "of the frame before", "#5bb98c"],
  ["total", "total", "end of burst to finished set", "#c2b8a3"],
];

export class Times {
  #rows = new Map(); #sum; #kept = new Map(STAGES.map(([stage]) => [stage, []])); #budgets = {}; #run = null; #drawn = 0; #rate = 0;

  constructor(box) {
    this.#sum = box.appendChild(element("p", "", { className: "hint" }));
    const table = box.appendChild(element("table", "", { className: "times" })), head = table.createTHead().insertRow();
    for (const name of ["Stage", "In its budget", "Last frames", "Now / budget", "95 %", "Over"]) head.append(element("th", name, { scope: "col" }));
    const body = table.createTBody();
    for (const [stage, name, note, colour] of STAGES) {
      const row = body.insertRow(), title = row.appendChild(element("th", name, { scope: "row", title: note }));
      title.id = `t-${stage}`;
      const bar = row.insertCell().appendChild(element("div", "", { className: "bar-of" })), part = bar.appendChild(element("i", "")), tick = bar.appendChild(element("b", ""));
      bar.setAttribute("aria-hidden", "true");
      part.style.background = colour;
      const curve = row.insertCell().appendChild(element("canvas", "", { className: "curve" }));
      curve.setAttribute("role", "img");
      const both = row.insertCell(), now = both.appendChild(element("span", "")), budget = both.appendChild(element("small", ""));
      const most = row.insertCell(), over = row.insertCell();
      Object.entries({ now, budget, most, over }).forEach(([kind, box]) => { box.id = `t-${stage}-${kind}`; });
      this.#rows.set(stage, { row, part, tick, curve, now, most, budget, over, colour, name });
    }
  }

  /** Updates bars and curves with a new light set. */
  take({ run, latency_us: us, overrun }) {
    if (run !== this.#run) {
      this.#run = run;
      for (const values of this.#kept.values()) values.length = 0;
    }
    for (const [stage, values] of this.#kept) {
      values.push(us[stage]);
      if (values.length > KEPT) values.shift();
    }
    const now = performance.now();
    if (now - this.#drawn < PAUSE) return;
    this.#drawn = now;
    for (const [stage, row] of this.#rows) this.#show(stage, row, us[stage], (overrun ?? []).includes(stage));
    // Drawing a curve reads its size, so all texts that change it are written before.
    for (const [stage, row] of this.#rows) this.#draw(stage, row);
    const period = this.#rate > 0 ? 1e6 / this.#rate : null;
    this.#sum.textContent = `${duration(us.total / 1e6)} from the end of the burst to the finished set` +
      (period ? `, ${(100 * us.total / period).toFixed(0)} % of the ${duration(period / 1e6)} between frames.` : ".");
  }

  #show(stage, { row, part, tick, now }, us, isOver) {
    const budget = this.#budgets[stage], values = this.#kept.get(stage);
    row.classList.toggle("over", isOver);
    write(now, milliseconds(us));
    part.style.width = budget ? `${100 * Math.min(1, FULL * us / budget)}%` : "0";
    const high = [...values].sort((a, b) => a - b)[Math.floor(0.95 * (values.length - 1))];
    tick.style.left = budget ? `${100 * Math.min(1, FULL * high / budget)}%` : "0";
  }

  #draw(stage, { curve, colour, name }) {
    const values = this.#kept.get(stage), most = Math.max(...values, 1);
    curves(curve, KEPT, niceAbove(1.1 * most), [[colour, values]], { line: this.#budgets[stage] });
    curve.setAttribute("aria-label", `${name}, last ${values.length} frames: at most ${milliseconds(most)} milliseconds`);
  }

  /** Updates budgets, percentiles since the start and overruns with an answer of `/v1/status`. */
  status({ stages, frames, last }) {
    this.#rate = last?.rate_hz ?? 0;
    for (const { stage, budget_us, overruns, p50_us, p95_us, p99_us, max_us, last_minute } of stages ?? []) {
      const row = this.#rows.get(stage);
      if (!row) continue;
      this.#budgets[stage] = budget_us;
      write(row.most, duration(p95_us / 1e6));
      write(row.budget, ` / ${Number(figures(budget_us / 1000, 4))} ms`);
      write(row.over, overruns === 0 ? "never" : `${share(overruns / Math.max(1, frames))} %`);
      row.row.title = `since the start, ${frames} frames: half within ${milliseconds(p50_us)} ms, 95 % ${milliseconds(p95_us)}, 99 % ${milliseconds(p99_us)}, all ${milliseconds(max_us)}; ${overruns} over budget` +
        (last_minute ? `; in the last minute half within ${milliseconds(last_minute.p50_us)} ms, 99 % ${milliseconds(last_minute.p99_us)}` : "");
    }
  }
}

const share = v => figures(100 * v, 100 * v >= 10 ? 2 : 1);

function write(box, text) {
  if (box.textContent !== text) box.textContent = text;
}
