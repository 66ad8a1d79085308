// Draws the surface (sorted from back to front), cameras, cube and grasps onto a canvas.
(() => {
  const canvas = document.getElementById("scene"), pen = canvas.getContext("2d");
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const vertices = new Float32Array(bytes(data.vertices).buffer);
  const faces = new Uint32Array(bytes(data.faces).buffer);
  const colours = bytes(data.colours);
  const count = faces.length / 3;
  let azimuth = data.azimuth, height = 0.62, zoom = 1, chosen = -1;

  // Light on every face, once: from above and a little from the side.
  const shade = new Float32Array(count);
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [0, 1, 2].map((k) => vertices.subarray(3 * faces[3 * f + k], 3 * faces[3 * f + k] + 3));
    const u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]], v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n) || 1;
    shade[f] = 0.72 + 0.28 * Math.max(0, (0.3 * n[0] - 0.4 * n[1] + 0.86 * n[2]) / length);
  }

  function camera() {
    const [ca, sa, ch, sh] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(height), Math.sin(height)];
    const right = [-sa, ca, 0], up = [-ca * sh, -sa * sh, ch], back = [ca * ch, sa * ch, sh];
    const scale = (Math.min(canvas.width, canvas.height * 1.4) / 0.5) * zoom, far = 1.1;
    return (x, y, z) => {
      const p = [x - data.centre[0], y - data.centre[1], z - data.centre[2]];
      const depth = far - (p[0] * back[0] + p[1] * back[1] + p[2] * back[2]);
      const size = (scale * far) / Math.max(depth, 0.05);
      return [
        canvas.width / 2 + size * (p[0] * right[0] + p[1] * right[1]),
        canvas.height * 0.52 - size * (p[0] * up[0] + p[1] * up[1] + p[2] * up[2]),
        depth,
      ];
    };
  }

  function lines(project, segments, colour, width) {
    pen.strokeStyle = colour;
    pen.lineWidth = width * devicePixelRatio;
    pen.lineCap = "round";
    pen.beginPath();
    for (const [a, b] of segments) {
      const p = project(...a), q = project(...b);
      pen.moveTo(p[0], p[1]);
      pen.lineTo(q[0], q[1]);
    }
    pen.stroke();
  }

  function draw() {
    canvas.width = canvas.clientWidth * devicePixelRatio;
    canvas.height = canvas.clientHeight * devicePixelRatio;
    const project = camera();
    pen.fillStyle = "#f7f8fa";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    lines(project, data.cube, "#c3cad6", 1);
    const points = new Float32Array(vertices.length);
    for (let i = 0; i < vertices.length; i += 3) points.set(project(vertices[i], vertices[i + 1], vertices[i + 2]), i);
    const depth = (f) => points[3 * faces[3 * f] + 2] + points[3 * faces[3 * f + 1] + 2] + points[3 * faces[3 * f + 2] + 2];
    const order = Uint32Array.from({ length: count }, (_, f) => f);
    const depths = Float32Array.from(order, depth);
    order.sort((f, g) => depths[g] - depths[f]);
    for (const f of order) {
      const [r, g, b] = [0, 1, 2].map((k) => Math.round(colours[3 * f + k] * shade[f]));
      pen.fillStyle = pen.strokeStyle = `rgb(${r},${g},${b})`;
      pen.lineWidth = 1;
      pen.beginPath();
      for (let k = 0; k < 3; k++) {
        const i = 3 * faces[3 * f + k];
        k ? pen.lineTo(points[i], points[i + 1]) : pen.moveTo(points[i], points[i + 1]);
      }
      pen.closePath();
      pen.fill();
      pen.stroke();
    }
    for (const frustum of data.cameras) lines(project, frustum, "#7d8798", 1);
    for (let i = data.grasps.length - 1; i >= 0; i--) {
      const grasp = data.grasps[i];
      if (chosen >= 0 && i !== chosen) continue;
      lines(project, grasp.lines, "rgba(20,20,20,0.75)", 5);
      lines(project, grasp.lines, grasp.colour, 2.6);
      // The last line is the arm's.
      const [x, y] = project(...grasp.lines[grasp.lines.length - 1][0]), size = 9 * devicePixelRatio;
      pen.fillStyle = grasp.colour;
      pen.beginPath();
      pen.arc(x, y, size, 0, 2 * Math.PI);
      pen.fill();
      pen.fillStyle = "#000";
      pen.font = `${1.4 * size}px system-ui, sans-serif`;
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.fillText(grasp.number, x, y);
    }
  }

  let last = null;
  canvas.onpointerdown = (e) => { last = e; canvas.setPointerCapture(e.pointerId); };
  canvas.onpointerup = () => { last = null; };
  canvas.onpointermove = (e) => {
    if (!last) return;
    azimuth -= 0.008 * (e.clientX - last.clientX);
    height = Math.min(1.55, Math.max(-0.2, height + 0.008 * (e.clientY - last.clientY)));
    last = e;
    draw();
  };
  canvas.onwheel = (e) => { e.preventDefault(); zoom *= Math.exp(-0.001 * e.deltaY); draw(); };
  document.querySelectorAll("#grasps tbody tr").forEach((row, i) => {
    row.style.cursor = "pointer";
    row.onclick = () => { chosen = chosen === i ? -1 : i; draw(); };
  });
  addEventListener("resize", draw);
  draw();
})();
