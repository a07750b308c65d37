"use strict";
// Elements, settings and the socket's address, for all pages.

const element = (id) => document.getElementById(id);
const settings = JSON.parse(element("settings").textContent);

// An element with a class and children; strings become text nodes, so that text of a trace is never parsed as HTML.
function make(tag, className, ...children) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.append(...children);
  return made;
}

// A coloured symbol of a legend.
function swatch(colour, className = "") {
  const made = make("i", className);
  made.style.setProperty("--c", colour);
  return made;
}

// Address of the page's socket; the query carries the token.
const socketUrl = (query) => `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket?${query}`;
