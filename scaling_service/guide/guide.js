// Search over all sections, without a server; on narrow screens the contents begin folded.
"use strict";
const input = document.getElementById("words");
const found = document.getElementById("found");
const article = document.querySelector("article");
const MOST = 20;
const AROUND = 90;

const lower = (section) => `${section.page_title} ${section.title} ${section.text}`.toLowerCase();
const haystacks = SECTIONS.map(lower);

function weigh(section, words) {
  const title = `${section.title} ${section.page_title}`.toLowerCase();
  const text = section.text.toLowerCase();
  const inTitle = words.filter((word) => title.includes(word)).length;
  const inText = words.reduce((sum, word) => sum + text.split(word).length - 1, 0);
  return 1e6 * inTitle + inText;
}

function excerpt(text, words) {
  const at = Math.max(0, Math.min(...words.map((word) => text.toLowerCase().indexOf(word)).filter((k) => k >= 0), text.length) - AROUND);
  const shown = document.createElement("p");
  let rest = (at > 0 ? "… " : "") + text.slice(at, at + 3 * AROUND) + (at + 3 * AROUND < text.length ? " …" : "");
  const escaped = words.map((word) => word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
  for (const part of rest.split(new RegExp(`(${escaped.join("|")})`, "i"))) {
    const hit = words.includes(part.toLowerCase());
    shown.append(hit ? Object.assign(document.createElement("mark"), { textContent: part }) : part);
  }
  return shown;
}

function show() {
  const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
  const hits = words.length === 0 ? [] : SECTIONS.filter((_, k) => words.every((word) => haystacks[k].includes(word)));
  hits.sort((a, b) => weigh(b, words) - weigh(a, words));
  found.replaceChildren(...hits.slice(0, MOST).map((section) => {
    const entry = document.createElement("li");
    const link = document.createElement("a");
    link.href = `${section.page}.html${section.anchor ? `#${section.anchor}` : ""}`;
    link.textContent = section.anchor ? `${section.page_title}: ${section.title}` : section.page_title;
    link.addEventListener("click", () => { input.value = ""; show(); });
    entry.append(link, excerpt(section.text, words));
    return entry;
  }));
  if (words.length > 0 && hits.length === 0) found.append("Nothing found. Try fewer or shorter words.");
  found.hidden = words.length === 0;
  article.hidden = words.length > 0;
}

input.addEventListener("input", show);
document.getElementById("search").addEventListener("submit", (event) => {
  event.preventDefault();
  found.querySelector("a")?.click();
});
document.addEventListener("keydown", (event) => {
  if (event.key === "/" && document.activeElement !== input) { event.preventDefault(); input.focus(); }
});
if (matchMedia("(max-width: 800px)").matches) document.querySelector("#contents details").open = false;
