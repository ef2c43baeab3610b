(function () {
  "use strict";
  var page = document.documentElement;
  page.classList.add("scripted");

  // Tables are sorted by what their cells say, or by data-value where that is a number.
  function value(row, column) {
    var cell = row.cells[column], raw = cell.getAttribute("data-value");
    return raw === null ? cell.textContent.trim() : parseFloat(raw);
  }
  function compare(a, b) {
    if (typeof a === "number" && typeof b === "number") {
      if (isNaN(a) || isNaN(b)) { return (isNaN(a) ? 1 : 0) - (isNaN(b) ? 1 : 0); }
      return a - b;
    }
    return String(a).localeCompare(String(b), undefined, { numeric: true });
  }
  document.querySelectorAll("table.sortable").forEach(function (table) {
    Array.prototype.forEach.call(table.tHead.rows[0].cells, function (head, column) {
      var button = document.createElement("button");
      button.type = "button";
      while (head.firstChild) { button.appendChild(head.firstChild); }
      head.appendChild(button);
      button.addEventListener("click", function () {
        var down = head.getAttribute("aria-sort") === "ascending";
        Array.prototype.forEach.call(table.tHead.rows[0].cells, function (other) {
          other.removeAttribute("aria-sort");
        });
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        var body = table.tBodies[0], rows = Array.prototype.slice.call(body.rows);
        rows.sort(function (a, b) { return (down ? -1 : 1) * compare(value(a, column), value(b, column)); });
        rows.forEach(function (row) { body.appendChild(row); });
      });
    });
  });

  // All is open where there is no script, and on paper; on the screen the best class is.
  var folds = Array.prototype.slice.call(document.querySelectorAll("details.fold"));
  function fold(open) { folds.forEach(function (each) { each.open = open; }); }
  folds.forEach(function (each) { each.open = each.hasAttribute("data-first"); });
  document.querySelectorAll("[data-fold]").forEach(function (button) {
    button.addEventListener("click", function () { fold(button.getAttribute("data-fold") === "open"); });
  });
  var before = null;
  window.addEventListener("beforeprint", function () {
    before = folds.map(function (each) { return each.open; });
    fold(true);
  });
  window.addEventListener("afterprint", function () {
    if (before) { folds.forEach(function (each, i) { each.open = before[i]; }); }
    before = null;
  });
  function reveal() {
    var target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (target && target.tagName === "DETAILS") { target.open = true; target.scrollIntoView(); }
  }
  window.addEventListener("hashchange", reveal);
  reveal();

  // What is cut at the edge of the page says that it can be scrolled.
  function mark() {
    document.querySelectorAll(".scroll").forEach(function (each) {
      each.classList.toggle("cut", each.scrollWidth > each.clientWidth + 1);
    });
  }
  document.querySelectorAll("details").forEach(function (each) { each.addEventListener("toggle", mark); });
  window.addEventListener("resize", mark);
  mark();

  // Points of the figures say what they are.
  var tip = document.getElementById("tip");
  function show(point) {
    var box = point.getBoundingClientRect();
    tip.textContent = point.getAttribute("data-tip");
    tip.style.display = "block";
    var left = box.left + box.width / 2 - tip.offsetWidth / 2;
    var top = box.top - tip.offsetHeight - 6;
    tip.style.left = Math.max(4, Math.min(left, page.clientWidth - tip.offsetWidth - 4)) + "px";
    tip.style.top = (top < 4 ? box.bottom + 6 : top) + "px";
  }
  function hide() { tip.style.display = "none"; }
  ["mouseover", "focusin", "click"].forEach(function (kind) {
    document.addEventListener(kind, function (event) {
      var point = event.target.closest ? event.target.closest("[data-tip]") : null;
      if (point) { show(point); } else { hide(); }
    });
  });
  document.addEventListener("focusout", hide);
  window.addEventListener("scroll", hide, { passive: true });
  document.querySelectorAll("[data-tip]").forEach(function (point) {
    point.setAttribute("aria-label", point.getAttribute("data-tip"));
  });
}());
