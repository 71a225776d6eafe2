// Fills the inner frames of scenes, each when it comes near the part of the page that is seen, all before a print.
"use strict";
(() => {
  const fill = (frame) => {
    const page = JSON.parse(frame.nextElementSibling.textContent);
    const viewer = document.getElementById("aacmm-viewer").textContent;
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
    const frames = document.querySelectorAll("iframe.aacmm-scene");
    frames.forEach((frame) => near.observe(frame));
    window.addEventListener("beforeprint", () => {
      near.disconnect();
      frames.forEach((frame) => frame.srcdoc || fill(frame));
    });
  };
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start);
  else start();
})();
