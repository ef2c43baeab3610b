/* Mode shapes that move. Every element of class "moving" holds its scenes as JSON; for each a
   canvas shows the nodes at rest and displaced, with the measured motion at the sensors. */
(function () {
  "use strict";
  var REACH = 0.28;      // the largest displacement, of half the largest side of the structure
  var PERIOD = 1800;     // milliseconds of a cycle
  var FIRST = { turn: 0.5, tilt: 0.35, zoom: 1 };
  var calm = window.matchMedia("(prefers-reduced-motion: reduce)");
  var onPaper = ["#b5bec8", "#0072b2", "#d55e00", "#444444"];

  function element(kind, inside, text, name) {
    var made = document.createElement(kind);
    if (text) { made.textContent = text; }
    if (name) { made.className = name; }
    if (inside) { inside.appendChild(made); }
    return made;
  }

  // Where a point is on the picture: right, up, and how far away; of a structure seen from above.
  function seen(point, view) {
    var c = Math.cos(view.turn), s = Math.sin(view.turn);
    var right = c * point[0] + s * point[1], away = c * point[1] - s * point[0];
    var up = Math.cos(view.tilt), back = Math.sin(view.tilt);
    return [right, up * point[2] + back * away, up * away - back * point[2]];
  }

  function displaced(scene, mode, share) {
    return scene.nodes.map(function (at, i) {
      var by = mode.moves[i];
      return [at[0] + share * by[0], at[1] + share * by[1], at[2] + share * by[2]];
    });
  }

  function ofSensor(sensor, component, share) {
    return sensor.at.map(function (x, i) { return x + share * component * sensor.along[i]; });
  }

  // A colour between two of them, "#rrggbb".
  function mixed(from, to, share) {
    var parts = [1, 3, 5].map(function (i) {
      var a = parseInt(from.slice(i, i + 2), 16), b = parseInt(to.slice(i, i + 2), 16);
      return Math.round(a + Math.min(1, share) * (b - a));
    });
    return "rgb(" + parts.join(",") + ")";
  }

  function path(pen, points, closed) {
    pen.beginPath();
    points.forEach(function (p, i) { if (i) { pen.lineTo(p[0], p[1]); } else { pen.moveTo(p[0], p[1]); } });
    if (closed) { pen.closePath(); }
  }

  /* One picture: share is the displacement drawn, from -1 to 1, colours are those of what is still,
     of what moves most, of measured motion and of letters. */
  function paint(canvas, scene, mode, view, share, colours, ratio) {
    var width = canvas.clientWidth, height = canvas.clientHeight, pen = canvas.getContext("2d");
    if (!width || !height) { return; }
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.lineJoin = "round";
    var wide = 0, high = 0;
    scene.nodes.forEach(function (at) {
      wide = Math.max(wide, Math.hypot(at[0], at[1]));
      high = Math.max(high, Math.abs(at[2]));
    });
    var half = [wide + REACH, Math.cos(view.tilt) * high + Math.sin(Math.abs(view.tilt)) * wide + REACH / 2];
    var scale = view.zoom * Math.min(width / half[0], height / half[1]) / 2.1;
    function screen(point) {
      var p = seen(point, view);
      return [width / 2 + scale * p[0], height / 2 - scale * p[1], p[2]];
    }
    var by = REACH * share;
    var rest = scene.nodes.map(screen), now = displaced(scene, mode, by).map(screen);
    var size = mode.moves.map(function (m) { return Math.hypot(m[0], m[1], m[2]); });
    function mean(corners, of) { return corners.reduce(function (t, i) { return t + of(i); }, 0) / corners.length; }

    pen.strokeStyle = colours[0];
    pen.lineWidth = 1;
    pen.setLineDash([3, 3]);
    scene.lines.forEach(function (line) { path(pen, [rest[line[0]], rest[line[1]]]); pen.stroke(); });
    pen.setLineDash([]);
    var parts = scene.faces.concat(scene.lines).map(function (corners) {
      return { corners: corners, away: mean(corners, function (i) { return now[i][2]; }) };
    });
    if (!parts.length) { parts = now.map(function (p, i) { return { corners: [i], away: p[2] }; }); }
    parts.sort(function (a, b) { return b.away - a.away; });
    parts.forEach(function (part) {
      var n = part.corners.length, points = part.corners.map(function (i) { return now[i]; });
      var colour = mixed(colours[0], colours[1], mean(part.corners, function (i) { return size[i]; }));
      if (n > 2) {
        path(pen, points, true);
        pen.globalAlpha = 0.55;
        pen.fillStyle = colour;
        pen.fill();
        pen.globalAlpha = 1;
      } else if (n === 2) {
        path(pen, points);
        pen.strokeStyle = colour;
        pen.lineWidth = 2.2;
        pen.stroke();
      } else { dot(points[0], 1.6, colour); }
    });
    function dot(p, radius, fill, ring) {
      pen.beginPath();
      pen.arc(p[0], p[1], radius, 0, 2 * Math.PI);
      if (fill) { pen.fillStyle = fill; pen.fill(); }
      if (ring) { pen.strokeStyle = ring; pen.lineWidth = 2.2; pen.stroke(); }
    }
    // What no line or face reaches: appendages.
    var joined = {};
    scene.faces.concat(scene.lines).forEach(function (c) { c.forEach(function (i) { joined[i] = true; }); });
    if (scene.lines.length) {
      now.forEach(function (p, i) {
        if (joined[i]) { return; }
        path(pen, [rest[i], p]);
        pen.strokeStyle = colours[1];
        pen.lineWidth = 1.2;
        pen.stroke();
        pen.fillStyle = colours[1];
        pen.fillRect(p[0] - 5, p[1] - 5, 10, 10);
      });
    }
    scene.sensors.forEach(function (sensor, i) {
      if (mode.model && mode.model[i] !== null) { dot(screen(ofSensor(sensor, mode.model[i], by)), 3.5, colours[1]); }
      if (mode.measured[i] === null) { return; }
      var end = screen(ofSensor(sensor, mode.measured[i], by));
      path(pen, [screen(sensor.at), end]);
      pen.strokeStyle = colours[2];
      pen.lineWidth = 1.8;
      pen.stroke();
      dot(end, 6, null, colours[2]);
      var half = mode.half[i];
      if (half === null) { return; }
      path(pen, [-1, 1].map(function (side) {
        return screen(ofSensor(sensor, mode.measured[i] + side * half, by));
      }));
      pen.lineWidth = 4;
      pen.stroke();
    });
    // Axes, at the lower left.
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.strokeStyle = pen.fillStyle = colours[3];
    pen.lineWidth = 1;
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach(function (axis, i) {
      var p = seen(axis, view), x = 38, y = height - 34;
      path(pen, [[x, y], [x + 20 * p[0], y - 20 * p[1]]]);
      pen.stroke();
      pen.fillText("xyz"[i], x + 29 * p[0], y - 29 * p[1]);
    });
  }

  function start(box) {
    var scenes = JSON.parse(box.querySelector("script").textContent);
    scenes = scenes.filter(function (scene) { return scene.modes.length; });
    if (!scenes.length) { return; }
    var scene = scenes[0], mode = scene.modes[0], view = Object.assign({}, FIRST);
    var playing = !calm.matches, amplitude = 1, began = null, phase = 0, visible = true;

    var choices = element("div", box, "", "row");
    var canvas = element("canvas", box);
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    var note = element("p", box, "", "note");
    note.setAttribute("aria-live", "polite");
    var tools = element("div", box, "", "row");
    var legend = element("p", box, "", "legend");
    element("span", legend, "at rest");
    element("span", legend, scene.modes.some(function (m) { return m.model; }) ? "model" : "identified");
    if (scene.sensors.length) { element("span", legend, "measured, at the sensors, with 90 % intervals where errors are known", "measured"); }
    element("p", box, "Drag to turn, or use the arrow keys; + and − change the size, Home the view; the space bar stops and starts.", "help");
    var stills = element("div", box, "", "stills");

    var buttons = element("div", null, "", "row");
    if (scenes.length > 1) {
      var select = element("select", choices);
      select.setAttribute("aria-label", "Configuration");
      scenes.forEach(function (each, i) { element("option", select, each.name).value = i; });
      select.addEventListener("change", function () {
        scene = scenes[select.value];
        mode = scene.modes[0];
        list();
      });
    }
    choices.appendChild(buttons);
    var play = element("button", tools);
    var label = element("label", tools, "amplitude ");
    var slider = element("input", label);
    [["type", "range"], ["min", "0.1"], ["max", "2"], ["step", "0.1"], ["value", "1"]].forEach(function (set) {
      slider.setAttribute(set[0], set[1]);
    });

    function list() {
      buttons.textContent = "";
      scene.modes.forEach(function (each) {
        var button = element("button", buttons, each.title);
        button.type = "button";
        button.addEventListener("click", function () { mode = each; say(); });
      });
      say();
    }
    function say() {
      Array.prototype.forEach.call(buttons.children, function (button, i) {
        button.setAttribute("aria-pressed", String(scene.modes[i] === mode));
      });
      note.textContent = mode.title + ": " + mode.note;
      canvas.setAttribute("aria-label", "Moving shape of " + note.textContent);
      play.textContent = playing ? "Pause" : "Play";
      draw();
    }
    function colours() {
      var style = getComputedStyle(box);
      return ["--still", "--most", "--measured", "--soft"].map(function (name) {
        return style.getPropertyValue(name).trim();
      });
    }
    function draw() {
      paint(canvas, scene, mode, view, amplitude * Math.cos(phase), colours(), window.devicePixelRatio || 1);
    }
    function frame(now) {
      if (!playing) { began = null; return; }
      if (began === null) { began = now - phase * PERIOD / (2 * Math.PI); }
      phase = 2 * Math.PI * ((now - began) / PERIOD % 1);
      if (visible) { draw(); }
      requestAnimationFrame(frame);
    }
    function set(on) {
      playing = on;
      if (playing) { requestAnimationFrame(frame); } else { phase = 0; }
      say();
    }
    play.type = "button";
    play.addEventListener("click", function () { set(!playing); });
    slider.addEventListener("input", function () { amplitude = parseFloat(slider.value); draw(); });
    calm.addEventListener("change", function () { set(!calm.matches); });

    var dragged = null;
    canvas.addEventListener("pointerdown", function (event) {
      dragged = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", function (event) {
      if (!dragged) { return; }
      turn(0.01 * (dragged[0] - event.clientX), 0.01 * (event.clientY - dragged[1]));
      dragged = [event.clientX, event.clientY];
    });
    ["pointerup", "pointercancel"].forEach(function (kind) {
      canvas.addEventListener(kind, function () { dragged = null; });
    });
    function turn(across, up) {
      view.turn += across;
      view.tilt = Math.max(-1.57, Math.min(1.57, view.tilt + up));
      draw();
    }
    var keys = {
      ArrowLeft: function () { turn(0.1, 0); }, ArrowRight: function () { turn(-0.1, 0); },
      ArrowUp: function () { turn(0, 0.1); }, ArrowDown: function () { turn(0, -0.1); },
      "+": function () { view.zoom *= 1.1; draw(); }, "-": function () { view.zoom /= 1.1; draw(); },
      Home: function () { Object.assign(view, FIRST); draw(); }, " ": function () { set(!playing); },
    };
    canvas.addEventListener("keydown", function (event) {
      if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
    });

    if (window.IntersectionObserver) {
      new IntersectionObserver(function (seenNow) {
        visible = seenNow[seenNow.length - 1].isIntersecting;
        if (visible) { draw(); }
      }).observe(canvas);
    }
    window.addEventListener("resize", draw);
    // On paper: every mode of every scene at its largest displacement.
    window.addEventListener("beforeprint", function () {
      stills.textContent = "";
      stills.style.display = "grid";
      scenes.forEach(function (each) {
        each.modes.forEach(function (own) {
          var figure = element("figure", stills), picture = element("canvas", figure);
          element("figcaption", figure, (each.name ? each.name + ", " : "") + own.title + ": " + own.note);
          paint(picture, each, own, view, 1, onPaper, 3);
        });
      });
      stills.style.display = "";
    });
    list();
    set(playing);
  }

  Array.prototype.forEach.call(document.querySelectorAll(".moving"), start);
}());
