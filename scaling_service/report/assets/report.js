"use strict";
(function () {
  const CONFIG = { displayModeBar: false, displaylogo: false, responsive: true };
  const FILL = 2.0; // height of the stage in plotly's units, less a margin
  const PRINTED = { whole: 680, half: 330 }; // px at 96 per inch: A4 less its margins, and half of that

  // ---- charts: drawn when they come near the window, resized for paper ----
  function specification(figure) {
    return JSON.parse(figure.querySelector("script").textContent);
  }

  function draw(figure) {
    if (figure.drawn) return;
    figure.drawn = true;
    const spec = specification(figure);
    Plotly.newPlot(figure.querySelector(".plot"), spec.data, spec.layout, CONFIG);
  }

  function charts() {
    const figures = Array.from(document.querySelectorAll("figure.figure"));
    const watcher = new IntersectionObserver((seen) => {
      for (const entry of seen) if (entry.isIntersecting) { draw(entry.target); watcher.unobserve(entry.target); }
    }, { rootMargin: "600px" });
    figures.forEach((figure) => watcher.observe(figure));
    addEventListener("beforeprint", () => {
      document.querySelectorAll("details").forEach((d) => { d.wasOpen = d.open; d.open = true; });
      figures.forEach((figure) => {
        draw(figure);
        const width = figure.closest(".grid") ? PRINTED.half : PRINTED.whole;
        Plotly.relayout(figure.querySelector(".plot"), { width: width, height: figure.querySelector(".plot").clientHeight });
      });
    });
    addEventListener("afterprint", () => {
      document.querySelectorAll("details").forEach((d) => { d.open = d.wasOpen; });
      figures.forEach((figure) => Plotly.relayout(figure.querySelector(".plot"), { width: null, height: null, autosize: true }));
    });
  }

  // ---- the overlay: bodies over time in space ----
  function floats(text) {
    return new Float32Array(bytes(text).buffer);
  }
  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) out[k] = raw.charCodeAt(k);
    return out;
  }
  function webgl() {
    const canvas = document.createElement("canvas");
    return !!(canvas.getContext("webgl2") || canvas.getContext("webgl"));
  }

  // Points [x forward, y up, z right] are shown as [x, -z, y]: right-handed, up is up.
  function cloud(points, frame, count, indices) {
    const n = indices.length, base = frame * count * 3;
    const x = new Array(n), y = new Array(n), z = new Array(n);
    for (let k = 0; k < n; k++) {
      if (indices[k] < 0) { x[k] = y[k] = z[k] = null; continue; }
      const at = base + 3 * indices[k];
      x[k] = points[at]; y[k] = -points[at + 2]; z[k] = points[at + 1];
    }
    return { x: x, y: y, z: z };
  }
  function posed(vertices, pose, frame) {
    const n = vertices.length / 3, p = frame * 12, x = new Float32Array(n), y = new Float32Array(n), z = new Float32Array(n);
    for (let k = 0; k < n; k++) {
      const a = vertices[3 * k], b = vertices[3 * k + 1], c = vertices[3 * k + 2];
      x[k] = pose[p] * a + pose[p + 1] * b + pose[p + 2] * c + pose[p + 9];
      z[k] = pose[p + 3] * a + pose[p + 4] * b + pose[p + 5] * c + pose[p + 10];
      y[k] = -(pose[p + 6] * a + pose[p + 7] * b + pose[p + 8] * c + pose[p + 11]);
    }
    return { x: x, y: y, z: z };
  }
  function pairs(list) {
    return list.flatMap((pair) => [pair[0], pair[1], -1]);
  }
  // The body fills the stage in height, or in width where that is what is short.
  function proportions(box, stage) {
    const extent = (axis) => box[axis][1] - box[axis][0];
    const across = Math.hypot(extent("x"), extent("y"));
    const scale = Math.min(FILL / extent("z"), FILL * stage.clientWidth / stage.clientHeight / across);
    return { x: scale * extent("x"), y: scale * extent("y"), z: scale * extent("z") };
  }
  const range = (n) => Array.from({ length: n }, (_, k) => k);

  function scene(root) {
    if (!webgl()) { root.classList.add("flat-only"); return; }
    const spec = specification(root), stage = root.querySelector(".stage");
    const meshes = {};
    for (const name in spec.bones) {
      const faces = new Uint16Array(bytes(spec.bones[name].faces).buffer);
      meshes[name] = { vertices: floats(spec.bones[name].vertices),
        i: faces.filter((_, k) => k % 3 === 0), j: faces.filter((_, k) => k % 3 === 1), k: faces.filter((_, k) => k % 3 === 2) };
    }
    const parts = []; // {method, kind, trace, at(frame)}
    const measured = floats(spec.measured.points), n = spec.measured.labels.length;
    parts.push({ method: "", kind: "measured", at: (f) => cloud(measured, f, n, range(n)),
      trace: { type: "scatter3d", mode: "markers", text: spec.measured.labels, hovertemplate: "%{text} measured<extra></extra>",
        marker: { size: 3.5, color: spec.ink } } });
    for (const method of spec.methods) {
      const points = floats(method.points), count = method.count, title = method.name;
      const line = (kind, indices, width, dash) => parts.push({ method: method.name, kind: kind,
        at: (f) => cloud(points, f, count, indices),
        trace: { type: "scatter3d", mode: "lines", hoverinfo: "skip", line: { color: method.colour, width: width, dash: dash } } });
      line("sticks", pairs(method.sticks), 6, "solid");
      line("axes", pairs(method.axes), 4, "dash");
      parts.push({ method: method.name, kind: "centres", at: (f) => cloud(points, f, count, method.centres.map((c) => c[0])),
        trace: { type: "scatter3d", mode: "markers", text: method.centres.map((c) => c[1]),
          hovertemplate: "%{text}, " + title + "<extra></extra>", marker: { size: 5, color: method.colour } } });
      parts.push({ method: method.name, kind: "markers", at: (f) => cloud(points, f, count, method.markers.map((m) => m[0])),
        trace: { type: "scatter3d", mode: "markers", text: method.markers.map((m) => m[1]),
          hovertemplate: "%{text}, " + title + "<extra></extra>",
          marker: { size: 4, color: method.colour, symbol: "circle-open" } } });
      parts.push({ method: method.name, kind: "gaps",
        at: (f) => {
          const ours = cloud(points, f, count, method.markers.map((m) => m[0]));
          const theirs = cloud(measured, f, n, method.markers.map((m) => m[2]));
          const woven = {};
          for (const axis of ["x", "y", "z"]) woven[axis] = ours[axis].flatMap((v, k) => [v, theirs[axis][k], null]);
          return woven;
        },
        trace: { type: "scatter3d", mode: "lines", hoverinfo: "skip", line: { color: method.colour, width: 2 } } });
      for (const bone of method.bones) {
        const mesh = meshes[bone.name], pose = floats(bone.pose);
        parts.push({ method: method.name, kind: "bones", at: (f) => posed(mesh.vertices, pose, f),
          // Seen orthographically, plotly lights from the side opposite to lightposition (tried with version 4).
          trace: { type: "mesh3d", i: mesh.i, j: mesh.j, k: mesh.k, color: spec.bone, hoverinfo: "skip", flatshading: false,
            opacity: 0.8,
            // In metres a triangle's normal is tiny: without these it would count as degenerate and be black.
            lighting: { ambient: 0.55, diffuse: 0.7, specular: 0.05, roughness: 0.9, fresnel: 0.1, facenormalsepsilon: 0,
              vertexnormalsepsilon: 0 },
            lightposition: { x: -2, y: 6, z: -4 } } });
      }
    }
    const shown = (part) => part.kind === "measured" ||
      (root.querySelector(`input[data-method="${CSS.escape(part.method)}"]`).checked &&
        (root.querySelector(`input[data-kind="${part.kind}"]`) || { checked: true }).checked);
    const slider = root.querySelector("input[type=range]"), clock = root.querySelector("output");
    const cameras = { oblique: { x: 1.1, y: -1.5, z: 0.35 }, right: { x: 0, y: -2, z: 0.02 }, front: { x: 2, y: 0, z: 0.02 } };
    const axis = { visible: false, showspikes: false };
    const lay = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "#fff", uirevision: "kept",
      scene: { aspectmode: "manual", aspectratio: proportions(spec.box, stage), dragmode: "orbit", uirevision: "kept", hovermode: "closest",
        xaxis: Object.assign({ range: spec.box.x }, axis), yaxis: Object.assign({ range: spec.box.y }, axis),
        zaxis: Object.assign({ range: spec.box.z }, axis),
        camera: { eye: cameras.oblique, projection: { type: "orthographic" } } },
    };
    const floor = Object.assign({ type: "scatter3d", mode: "lines", hoverinfo: "skip", line: { color: "#d5dae0", width: 1 } }, spec.floor);
    const frame = () => Number(slider.value);
    const tell = () => { clock.textContent = spec.times[frame()].toFixed(2) + " s"; };
    const traces = parts.map((part) => Object.assign({}, part.trace, part.at(frame()), { visible: shown(part) }));
    Plotly.newPlot(stage, [...traces, floor], lay, Object.assign({}, CONFIG, { scrollZoom: false }));
    tell();

    let waiting = false;
    function move() { // only what is seen is moved; what is shown later is moved then
      tell();
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        const indices = [], change = { x: [], y: [], z: [] };
        parts.forEach((part, k) => {
          if (!shown(part)) return;
          const now = part.at(frame());
          indices.push(k); change.x.push(now.x); change.y.push(now.y); change.z.push(now.z);
        });
        Plotly.restyle(stage, change, indices);
      });
    }
    slider.addEventListener("input", move);
    root.querySelectorAll("input[type=checkbox]").forEach((box) => box.addEventListener("change", () => {
      Plotly.restyle(stage, { visible: parts.map(shown) }, range(parts.length)).then(move);
    }));
    root.querySelectorAll("button[data-view]").forEach((button) => button.addEventListener("click", () => {
      Plotly.relayout(stage, { "scene.camera.eye": cameras[button.dataset.view], "scene.camera.up": { x: 0, y: 0, z: 1 },
        "scene.camera.center": { x: 0, y: 0, z: 0 } });
    }));
    const play = root.querySelector("button[data-play]");
    let timer = null;
    play.addEventListener("click", () => {
      if (timer) { clearInterval(timer); timer = null; play.textContent = "Play"; return; }
      play.textContent = "Pause";
      timer = setInterval(() => { slider.value = (frame() + 1) % spec.times.length; move(); }, spec.pause_ms);
    });
  }

  document.querySelectorAll(".scene").forEach(scene);
  charts();
})();
