(function () {
  "use strict";
  var page = document.documentElement;
  page.classList.add("scripted");

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
}());
