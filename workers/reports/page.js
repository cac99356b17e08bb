"use strict";
// What is chosen in one plot is chosen in all. Points are the drawn elements of the group NAME-points, in the order of
// data.plots[NAME], which holds the number of each one's pair.
const data = JSON.parse(document.getElementById("data").textContent);
const pairs = data.pairs;
const chosen = new Set();
const leftOut = new Set();
const elements = new Map();
const plots = new Map();

for (const [name, numbers] of Object.entries(data.plots)) {
  const group = document.getElementById(`${name}-points`);
  if (!group || numbers.length === 0) continue;
  const points = [...group.querySelectorAll("use, path")].filter((one) => !one.closest("defs"));
  plots.set(name, { points, numbers });
  points.forEach((point, i) => {
    point.dataset.pair = numbers[i];
    if (!elements.has(numbers[i])) elements.set(numbers[i], []);
    elements.get(numbers[i]).push(point);
  });
}

const SHOWN = ["x", "y", "z", "u", "v", "error_px", "heldout_px", "range_m", "angle_deg", "seconds", "frame_index", "group", "corner"];
const columns = SHOWN.filter((name) => name in pairs);
const table = document.getElementById("pair-table");
const rows = [];

function fillTable() {
  if (rows.length > 0) return;
  const head = table.createTHead().insertRow();
  for (const name of ["pair", ...columns]) {
    const cell = document.createElement("th");
    cell.scope = "col";
    cell.textContent = name;
    head.append(cell);
  }
  const body = table.createTBody();
  for (let i = 0; i < pairs.u.length; i++) {
    const row = body.insertRow();
    const first = row.insertCell();
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.choose = i;
    button.textContent = i;
    first.append(button);
    for (const name of columns) {
      const value = pairs[name][i];
      row.insertCell().textContent = typeof value === "number" ? Number(value.toPrecision(5)) : (value ?? "–");
    }
    rows.push(row);
  }
  show();
}

function show() {
  for (const [pair, points] of elements) {
    for (const point of points) {
      point.classList.toggle("chosen", chosen.has(pair));
      point.classList.toggle("left-out", leftOut.has(pair));
    }
  }
  rows.forEach((row, i) => row.classList.toggle("chosen-row", chosen.has(i)));
  document.getElementById("chosen").hidden = chosen.size === 0 && leftOut.size === 0;
  document.getElementById("chosen-words").textContent = words();
  document.getElementById("leave-out").disabled = chosen.size === 0;
  const again = document.getElementById("calibrate-again");
  const numbers = [...leftOut].sort((a, b) => a - b).join(",");
  // Opened as a file, the page does not know where its service is.
  const served = location.protocol.startsWith("http");
  again.hidden = !served || leftOut.size === 0;
  if (served) {
    again.href = `/calibrations/${data.ids.calibration}?show=${encodeURIComponent(data.names.camera)}&leave_out=${numbers}`;
  }
  document.getElementById("copy-command").hidden = leftOut.size === 0;
}

function words() {
  const parts = [];
  if (chosen.size === 1) {
    const [i] = chosen;
    parts.push(
      `Pair ${i}: ${pairs.error_px[i].toPrecision(3)} px off, ${pairs.range_m[i].toPrecision(3)} m away, ` +
        `${pairs.angle_deg[i].toPrecision(3)} degrees from the axis.`,
    );
  } else if (chosen.size > 1) parts.push(`${chosen.size} pairs are chosen.`);
  if (leftOut.size > 0) parts.push(`${leftOut.size} to be left out.`);
  return parts.join(" ");
}

function choose(numbers, adding) {
  if (!adding) chosen.clear();
  for (const i of numbers) adding && chosen.has(i) && numbers.length === 1 ? chosen.delete(i) : chosen.add(i);
  show();
}

function centre(point) {
  const box = point.getBoundingClientRect();
  return [box.left + box.width / 2, box.top + box.height / 2];
}

for (const figure of document.querySelectorAll("figure[data-plot]")) {
  const plot = plots.get(figure.dataset.plot);
  if (!plot) continue;
  let from = null;
  figure.addEventListener("pointerdown", (event) => {
    if (event.button === 0) from = [event.clientX, event.clientY];
  });
  figure.addEventListener("pointerup", (event) => {
    if (!from) return;
    const [left, right] = [from[0], event.clientX].sort((a, b) => a - b);
    const [top, bottom] = [from[1], event.clientY].sort((a, b) => a - b);
    from = null;
    const at = plot.points.map(centre);
    let found;
    if (right - left > 4 || bottom - top > 4) {
      found = plot.numbers.filter((_, i) => at[i][0] >= left && at[i][0] <= right && at[i][1] >= top && at[i][1] <= bottom);
    } else {
      const away = at.map(([x, y]) => Math.hypot(x - left, y - top));
      const nearest = away.indexOf(Math.min(...away));
      found = away[nearest] < 12 ? [plot.numbers[nearest]] : [];
    }
    choose(found, event.shiftKey);
  });
  const order = plot.numbers.map((_, i) => i);
  figure.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    // From left to right as they are drawn.
    order.sort((a, b) => centre(plot.points[a])[0] - centre(plot.points[b])[0]);
    const here = order.findIndex((i) => chosen.has(plot.numbers[i]));
    const next = here < 0 ? 0 : (here + step + order.length) % order.length;
    choose([plot.numbers[order[next]]], event.shiftKey);
  });
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-choose]");
  if (button) choose([Number(button.dataset.choose)], event.shiftKey);
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") choose([], false);
  if (event.key === "Delete" && chosen.size > 0) leaveOut();
});
document.querySelector("#pairs details").addEventListener("toggle", fillTable);
document.getElementById("clear").addEventListener("click", () => {
  leftOut.clear();
  choose([], false);
});

function leaveOut() {
  for (const i of chosen) leftOut.add(i);
  choose([], false);
}
document.getElementById("leave-out").addEventListener("click", leaveOut);
document.getElementById("copy-command").addEventListener("click", async () => {
  const command = `apexcal recalibrate ${data.ids.result} --leave-out ${[...leftOut].sort((a, b) => a - b).join(",")}`;
  try {
    await navigator.clipboard.writeText(command);
    document.getElementById("chosen-words").textContent = "The command is copied.";
  } catch {
    document.getElementById("chosen-words").textContent = command;
  }
});
document.getElementById("save-data").addEventListener("click", () => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([JSON.stringify(data)], { type: "application/json" }));
  link.download = "report.json";
  link.click();
});
