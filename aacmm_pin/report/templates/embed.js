// Fills the inner frames of scenes: each when it comes near the part of the page that is seen, the others when all is quiet,
// so that they are there on paper and in pictures of the whole page. What is not drawn yet takes no room on paper: printing
// does not wait for it.
"use strict";
(() => {
  const QUIET = 500; // milliseconds from one scene to the next
  const fill = (frame) => {
    if (frame.srcdoc) return;
    const page = JSON.parse(frame.nextElementSibling.textContent);
    const viewer = document.getElementById("aacmm-viewer").textContent;
    frame.addEventListener("load", () => frame.classList.toggle("drawn", "page" in frame.contentWindow));
    frame.srcdoc = page.replace("<!-- viewer -->", () => `<script>${viewer}</` + "script>");
  };
  const start = () => {
    const near = new IntersectionObserver((entries) => {
      for (const { isIntersecting, target } of entries) {
        if (isIntersecting) {
          near.unobserve(target);
          fill(target);
        }
      }
    }, { rootMargin: "400px" });
    const frames = [...document.querySelectorAll("iframe.aacmm-scene")];
    frames.forEach((frame) => near.observe(frame));
    window.addEventListener("load", () => frames.forEach((frame, k) => setTimeout(() => fill(frame), QUIET * (k + 1))));
  };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
