// Panels along one recording, drawn by uPlot; all follow one cursor and one range of time.
"use strict";
(() => {
  const page = JSON.parse(document.getElementById("recordings").textContent);
  const place = document.getElementById("charts");
  const HEIGHT = { state: 190, input: 120, "input held": 120, residual: 130, guard: 130 };
  const INK = "#1b1b1b", GREY = "#777"; // colours are modes, and nothing else
  const FONT = "12px system-ui, sans-serif";
  let drawn = [];

  const colour = (mode) => page.colours[mode % page.colours.length];
  const isDark = (ink) => {
    const [red, green, blue] = [1, 3, 5].map((k) => parseInt(ink.slice(k, k + 2), 16));
    return 0.299 * red + 0.587 * green + 0.114 * blue < 140;
  };
  const modeAt = (stays, t) => {
    const stay = stays.find((one) => t <= one[1]) || stays[stays.length - 1];
    return stay[2];
  };
  const named = (mode) => (mode === null ? "--" : mode < 0 ? "ended" : `mode ${mode}`);
  const digits = (value) => (value === null || value === undefined ? "--" : +value.toPrecision(5));

  // a stay is a rectangle of its mode's colour, with its number where that has room
  const bands = (u, stays, bottom, top, opacity, numbered) => {
    const ratio = devicePixelRatio, context = u.ctx;
    context.save();
    context.beginPath();
    context.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
    context.clip();
    for (const [begin, end, mode] of stays) {
      if (mode < 0) continue;
      const left = u.valToPos(begin, "x", true), right = u.valToPos(end, "x", true);
      context.globalAlpha = opacity;
      context.fillStyle = colour(mode);
      context.fillRect(left, top, right - left, bottom - top);
      if (numbered && right - left > 12 * ratio) {
        context.globalAlpha = 1;
        context.fillStyle = isDark(colour(mode)) ? "#fff" : INK;
        context.font = `bold ${12 * ratio}px system-ui, sans-serif`;
        context.textAlign = "center";
        context.textBaseline = "middle";
        context.fillText(mode, (left + right) / 2, (top + bottom) / 2);
      }
    }
    context.restore();
  };
  const behind = (recording) => (u) =>
    bands(u, recording.modes, u.bbox.top + u.bbox.height, u.bbox.top, 0.13, false);
  const ribbon = (recording) => (u) => {
    const half = u.bbox.height / 2, gap = 1.5 * devicePixelRatio;
    bands(u, recording.modes, u.bbox.top + half - gap, u.bbox.top, 1, true);
    bands(u, recording.rolled, u.bbox.top + u.bbox.height, u.bbox.top + half + gap, 1, true);
  };

  const axis = (options) => ({ font: FONT, labelFont: FONT, stroke: INK, ticks: { width: 1 },
    grid: { stroke: "#e4e4e4", width: 1 },
    values: (u, splits) => splits.map((one) => +one.toPrecision(6)), ...options });
  const line = (at, ink) => (u) => {
    const y = u.valToPos(at, "y", true), context = u.ctx;
    if (y < u.bbox.top || y > u.bbox.top + u.bbox.height) return;
    context.save();
    context.strokeStyle = ink;
    context.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    context.beginPath();
    context.moveTo(u.bbox.left, y);
    context.lineTo(u.bbox.left + u.bbox.width, y);
    context.stroke();
    context.restore();
  };

  const looks = (kind, number) => {
    if (kind === "state" && number === 0) {
      return { stroke: GREY, width: 0, points: { show: true, size: 5, fill: GREY, width: 0 },
        paths: () => null };
    }
    const steps = kind === "input held" ? { paths: uPlot.paths.stepped({ align: 1 }) } : {};
    return { stroke: INK, width: 1.5, ...steps };
  };

  const panel = (title, data, options, hooks) => {
    const box = document.createElement("div");
    box.className = "panel";
    const heading = document.createElement("h3");
    heading.textContent = title;
    box.append(heading);
    place.append(box);
    drawn.push(new uPlot({
      width: place.clientWidth,
      padding: [8, 16, 0, 0],
      legend: { markers: { width: 0, fill: (u, k) => u.series[k].stroke() } },
      cursor: { sync: { key: "swsysid", setSeries: false }, points: { size: 7 } },
      hooks,
      ...options,
      scales: { x: { time: false }, ...options.scales },
    }, data, box));
  };

  const column = (recording, name) => recording.columns[name] ||
    recording.columns[name.replace("e", "y")].map((one, k) => { // what a rollout leaves
      const rolled = recording.columns[name.replace("e", "r")][k];
      return one === null || rolled === null ? null : one - rolled;
    });
  const draw = (recording) => {
    drawn.forEach((one) => one.destroy());
    drawn = [];
    place.querySelectorAll(".panel").forEach((one) => one.remove());
    const t = recording.columns.t;
    const time = { label: page.time, value: (u, value) => digits(value) };
    const mode = (label, stays) => ({ label, stroke: "transparent", width: 0, scale: "mode",
      points: { show: false }, paths: () => null, value: (u, value) => named(value) });
    panel("modes", [t, t.map((one) => modeAt(recording.modes, one)),
      t.map((one) => modeAt(recording.rolled, one))], {
      height: 66,
      series: [time, mode("recording"), mode("rollout")],
      scales: { y: { range: [0, 2] }, mode: { range: [0, 2] } },
      axes: [axis({ show: false }), axis({ scale: "mode", size: 78, grid: { show: false },
        ticks: { show: false }, splits: () => [0.5, 1.5],
        values: () => ["rollout", "recording"] })],
    }, { draw: [ribbon(recording)] });
    page.panels.forEach((one, number) => {
      const names = Object.keys(one.curves), last = number === page.panels.length - 1;
      const marks = one.kind === "guard" ? [line(0, GREY)]
        : one.kind === "residual" ? [line(2 * one.noise, GREY), line(-2 * one.noise, GREY)] : [];
      panel(one.title, [t, ...names.map((name) => column(recording, name))], {
        height: HEIGHT[one.kind] + (last ? 18 : 0),
        series: [time, ...names.map((name, k) => ({ label: one.curves[name],
          value: (u, value) => digits(value), ...looks(one.kind, k) }))],
        axes: [axis({ size: 28, ...(last ? { label: page.time, labelSize: 18 } : {}) }),
          axis({ size: 78, space: 24 })],
      }, { drawClear: [behind(recording)], draw: marks });
    });
  };

  const keys = document.createElement("div");
  keys.className = "keys";
  page.colours.forEach((ink, mode) => {
    const key = document.createElement("span"), patch = document.createElement("i");
    patch.style.background = ink;
    key.append(patch, `mode ${mode}`);
    keys.append(key);
  });
  place.append(keys);
  if (page.recordings.length > 1) {
    const label = document.createElement("label"), choice = document.createElement("select");
    label.append("recording");
    page.recordings.forEach((one, number) => choice.append(new Option(one.label, number)));
    choice.onchange = () => draw(page.recordings[choice.value]);
    label.append(choice);
    place.prepend(label);
  }
  draw(page.recordings[0]);
  addEventListener("resize", () =>
    drawn.forEach((one) => one.setSize({ width: place.clientWidth, height: one.height })));
})();
