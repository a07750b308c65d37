"use strict";
// The panels beside the map: condition, rules, unknown pairs, boxes, log, and attributes of the selected object.

const element = (name) => document.getElementById(name);

// An element with a class and children; strings become text nodes, so that text of a trace is never parsed as HTML.
function make(tag, style, ...children) {
  const made = document.createElement(tag);
  if (style) made.className = style;
  made.append(...children);
  return made;
}

const MAPPING_STEP = 0.2; // fraction of the area, or of a log, after which progress is logged

// A term without its first argument, the robot or taxi, which all terms share: "touch_N(wall)".
const shortTerm = (term) => term.replace(/\((robot|taxi), /, "(");

// Names of the terms that hold in a condition.
function holding(condition, terms) {
  const names = [...condition].flatMap((bit, at) => (bit === "1" ? [shortTerm(terms[at] ?? `term ${at + 1}`)] : []));
  return names.length ? names.join(", ") : "no term holds";
}

const PHASES = { explore: "Explores", localize: "Localizes", survey: "Looks for boxes", learn: "Learns", deliver: "Delivers", map: "Maps", done: "Done" };
const phaseName = (phase, began) => (phase === "deliver" && began.task === "learn" ? "Uses its rules" : PHASES[phase]) ?? phase ?? "";
const REASONS = {
  plan: "Part of its plan: the outcome is known.",
  experiment: "An experiment: the outcome is unknown under this condition.",
  way: "On the way to an experiment: the action leads to a condition with an unknown outcome.",
};
const TAGS = { plan: "", experiment: " · experiment", way: " · to an experiment" };
const SVG = "http://www.w3.org/2000/svg";

function clockText(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const minutes = Math.floor(whole / 60);
  return `${minutes}:${String(whole % 60).padStart(2, "0")}`;
}

// The bits of a condition; * (either) is shown paler.
function pattern(condition) {
  const made = make("code", "pattern");
  for (const bit of condition) made.append(make(bit === "*" ? "i" : "b", "", bit));
  return made;
}

// A condition as terms: "if touch_N(wall) and not in_bot", or "always".
function inWords(condition, terms) {
  const words = [...condition].flatMap((bit, at) => (bit === "*" ? [] : [(bit === "1" ? "" : "not ") + (terms[at] ?? `term ${at + 1}`)]));
  return words.length ? "if " + words.join(" and ") : "always";
}

// The same in few words: where every bit is given, only the terms that hold are named.
function inFewWords(condition, terms) {
  if (condition.includes("*")) return inWords(condition, terms.map(shortTerm));
  return condition.includes("1") ? `if only ${holding(condition, terms)}` : "if no term holds";
}

const covers = (condition, terms) => [...condition].every((bit, at) => bit === "*" || bit === terms[at]);

class Panels {
  constructor(trace, seek) {
    this.trace = trace;
    this.seek = seek;
    this.clear();
  }

  clear() {
    this.logged = { Said: 0, Stepped: 0, Learnt: 0, Explored: 0 };
    this.mappedSteps = 0; // mapping progress that was logged, in steps of MAPPING_STEP
    this.entries = []; // {time, node}
    this.chosen = -1; // index of the clicked entry, among entries of the same time
    this.marked = -1; // index of the last entry that is not later than the time shown
    this.shown = {};
    element("log").replaceChildren();
    element("bits").replaceChildren();
  }

  // Whether a value differs from that of the last call with the same name.
  changed(name, value) {
    if (this.shown[name] === value) return false;
    this.shown[name] = value;
    return true;
  }

  update(time) {
    const { trace } = this;
    const began = trace.records.Began[0];
    if (!began) return;
    const step = trace.at("Stepped", time);
    const perceived = trace.at("Perceived", time);
    const learnt = trace.at("Learnt", time);
    const condition = perceived?.condition ?? step?.condition;
    this.updateTitle(began, time);
    this.updateNow(time);
    this.updateBits(began, condition);
    this.updateRules(began, learnt, condition, time);
    this.updateProgress(step, perceived, time);
    this.updateExplored(trace.at("Explored", time), Boolean(step) || began.task === "localize");
    this.updateLog(time);
  }

  updateTitle(began, time) {
    if (this.changed("title", began)) element("subject").textContent = `${began.task} · ${began.subject}`;
    const phases = this.trace.phases();
    const phase = phases[lastNotAfter(phases, time, (band) => band.time)]?.phase;
    if (this.changed("phase", phase)) {
      element("phase").hidden = !phase;
      element("phase").textContent = phaseName(phase, began);
      element("phase").style.setProperty("--phase", `var(--${phase}-phase)`);
    }
  }

  // The action in progress, which is the next one to end, if it is in the trace already; otherwise the last narration.
  updateNow(time) {
    const { trace } = this;
    const steps = trace.records.Stepped;
    const next = steps[trace.indexAt("Stepped", time) + 1] ?? steps.at(-1);
    const acting = next && time >= trace.actsFrom && !this.isDone(time);
    const said = trace.at("Said", time);
    if (!this.changed("now", acting ? next : said)) return;
    const action = element("action");
    action.hidden = !acting;
    if (acting) {
      action.textContent = next.action;
      action.dataset.learning = next.learning;
      element("why").textContent = REASONS[this.reason(next)];
    } else element("why").textContent = said?.text ?? "";
  }

  // Reason of a step: "plan", "experiment" (no rule or failure condition predicts it), or "way" to an experiment.
  reason(step) {
    if (!step.learning) return "plan";
    const known = this.trace.records.Learnt[lastNotAfter(this.trace.records.Learnt, step.time - 1e-3, (learnt) => learnt.time)];
    const predictions = [...(known?.rules ?? []), ...(known?.failures[step.action] ?? []).map((condition) => [step.action, condition])];
    return predictions.some(([action, condition]) => action === step.action && covers(condition, step.condition)) ? "way" : "experiment";
  }

  isDone(time) {
    return this.trace.at("Said", time)?.phase === "done";
  }

  updateBits(began, condition) {
    element("symbols").hidden = !began.terms.length;
    if (!began.terms.length || !this.changed("bits", condition ?? null)) return;
    const list = element("bits");
    if (!list.children.length)
      for (const term of began.terms) {
        const name = make("span", "", shortTerm(term));
        name.title = term;
        list.append(make("li", "", make("b", "", "0"), name));
      }
    element("condition").textContent = condition ?? "";
    [...list.children].forEach((item, at) => {
      const on = condition?.[at] === "1";
      const state = condition?.[at] === undefined ? "unknown" : on ? "holds" : "does not hold";
      item.classList.toggle("on", on);
      item.firstChild.textContent = condition?.[at] ?? "–";
      item.setAttribute("aria-label", `${began.terms[at]}: ${state}`);
    });
  }

  updateRules(began, learnt, condition, time) {
    element("knowledge").hidden = !began.terms.length;
    if (!began.terms.length) return;
    const rulesChanged = this.changed("learnt", learnt);
    if (!rulesChanged && !this.changed("applies", condition)) return;
    this.shown.applies = condition;
    if (rulesChanged) this.makeRules(began, learnt, time);
    for (const item of element("rules").querySelectorAll("[data-condition]")) {
      const applies = condition !== undefined && covers(item.dataset.condition, condition);
      item.classList.toggle("applies", applies);
      item.title = applies ? "Applies now: its condition holds" : "Does not apply now";
    }
    for (const item of element("rules").querySelectorAll("[data-failure]")) item.classList.toggle("on", item.dataset.failure === condition);
  }

  makeRules(began, learnt, time) {
    const open = new Set([...element("rules").querySelectorAll("details[open]")].map((item) => item.dataset.action));
    const previous = new Set(this.ruleKeys ?? []);
    const fresh = this.rulesTime !== undefined && time >= this.rulesTime;
    const rules = learnt?.rules ?? [];
    const failures = learnt?.failures ?? {};
    this.rulesTime = time;
    this.ruleKeys = rules.map((rule) => rule.join(" "));
    const items = began.actions.flatMap((action) => {
      const made = rules.filter((rule) => rule[0] === action).map(([, condition, effect]) => {
        const item = this.ruleItem(action, condition, effect, began.terms);
        if (fresh && !previous.has([action, condition, effect].join(" "))) item.classList.add("new");
        return item;
      });
      const failing = failures[action] ?? [];
      if (failing.length && !made.length) made.push(make("li", "", make("div", "rule-top", make("b", "", action), make("span", "soft", "no known effect"))));
      if (failing.length) made.at(-1).append(this.failureList(action, failing, open.has(action)));
      return made;
    });
    const list = element("rules");
    list.replaceChildren(...items);
    const newest = [...list.querySelectorAll(".new")].at(-1);
    if (newest && !list.matches(":hover")) list.scrollTop = newest.offsetTop - list.offsetTop - list.clientHeight + newest.offsetHeight;
    element("no-rules").hidden = items.length > 0;
    element("rule-count").textContent = rules.length || "";
  }

  ruleItem(action, condition, effect, terms) {
    const top = make("div", "rule-top", make("b", "", action), make("span", "", effect), pattern(condition));
    const item = make("li", "", top, make("div", "rule-when", inWords(condition, terms.map(shortTerm))));
    item.dataset.condition = condition;
    return item;
  }

  failureList(action, conditions, open) {
    const summary = make("summary", "", `no effect in ${conditions.length}`);
    summary.title = `Number of conditions in which ${action} is known to have no effect; press to list them`;
    const items = conditions.map((condition) => {
      const { terms } = this.trace.records.Began[0];
      const item = make("span", "", inFewWords(condition, terms));
      item.title = `${condition}: ${inWords(condition, terms)}`;
      item.dataset.failure = condition;
      return item;
    });
    const details = make("details", "", summary, make("div", "fails", ...items));
    details.dataset.action = action;
    details.open = open;
    return details;
  }

  updateProgress(step, perceived, time) {
    element("progress").hidden = !step;
    if (!step) return;
    const steps = this.trace.records.Stepped;
    if (this.changed("step", step) | this.changed("steps", steps.length)) this.drawChart(steps, this.trace.indexAt("Stepped", time));
    const held = perceived?.things.some((object) => object.values.in_bot) ? 1 : 0;
    if (!this.changed("boxes", `${step.delivered} ${step.remaining} ${held}`)) return;
    const all = step.delivered + step.remaining;
    if (this.trace.records.Began[0].task === "learn") {
      element("counted").textContent = "Episodes";
      element("delivered").textContent = step.delivered;
      return;
    }
    element("delivered").textContent = `${step.delivered} of ${all}`;
    element("boxes").setAttribute("aria-label", `${step.delivered} of ${all} boxes delivered, ${held} in the fork`);
    element("boxes").replaceChildren(
      ...Array.from({ length: Math.min(all, 40) }, (_, at) => make("i", at < step.delivered ? "done" : at < step.delivered + held ? "held" : "")),
    );
  }

  // The number of unknown pairs after every action as a step chart; the future is shown paler.
  drawChart(steps, here) {
    const most = Math.max(1, ...steps.map((step) => step.unknown));
    const width = Math.max(steps.length - 1, 1);
    const point = (at) => [(160 * at) / width, 53 - (48 * steps[at].unknown) / most];
    const line = (from, to) => {
      let text = "";
      for (let at = from; at <= to; at++) {
        const [x, y] = point(at);
        text += at === from ? `M${x.toFixed(1)} ${y.toFixed(1)}` : `H${x.toFixed(1)}V${y.toFixed(1)}`;
      }
      return text;
    };
    const shape = (tag, attributes) => {
      const made = document.createElementNS(SVG, tag);
      for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
      return made;
    };
    const done = line(0, here);
    element("chart").replaceChildren(
      shape("line", { x1: 0, x2: 160, y1: 53, y2: 53 }),
      shape("path", { class: "area", d: `${done}V53H0Z` }),
      shape("path", { class: "rest", d: line(here, steps.length - 1) }),
      shape("path", { d: done }),
    );
    element("unknown").textContent = steps[here].unknown;
  }

  updateExplored(explored, past) {
    const fraction = explored && !past ? explored.fraction : null;
    if (!this.changed("explored", fraction)) return;
    element("exploring").hidden = fraction === null;
    element("exploring-name").textContent = this.trace.records.Began[0].task === "map" ? "Mapped part of the log" : "Explored";
    const percent = Math.round((fraction ?? 0) * 100);
    element("explored").textContent = `${percent} %`;
    element("meter").setAttribute("aria-valuenow", percent);
    element("meter").firstElementChild.style.width = `${percent}%`;
  }

  updateLog(time) {
    this.extendLog();
    const last = lastNotAfter(this.entries, time, (entry) => entry.time);
    if (this.chosen >= 0 && Math.abs(this.entries[this.chosen].time - time) > 1e-6) this.chosen = -1;
    const here = this.chosen >= 0 ? this.chosen : last;
    if (!this.changed("log", `${here} ${last} ${this.entries.length}`)) return;
    const list = element("log");
    list.querySelector(".here")?.classList.remove("here");
    for (let at = Math.min(this.marked, last) + 1; at <= Math.max(this.marked, last); at++)
      this.entries[at].node.classList.toggle("later", at > last);
    this.marked = last;
    const node = this.entries[here]?.node;
    if (!node) return;
    node.classList.add("here");
    if (!list.matches(":hover") && document.activeElement !== list) list.scrollTop = node.offsetTop - list.offsetTop - Math.max(0, Math.min(list.clientHeight * 0.7, list.clientHeight - node.offsetHeight));
  }

  // Append new narrations, actions and rules to the log, in order of time.
  extendLog() {
    const { records } = this.trace;
    const { terms, task } = records.Began[0];
    const lines = [];
    for (; this.logged.Said < records.Said.length; this.logged.Said++) {
      const said = records.Said[this.logged.Said];
      lines.push([said.time, 1, "said", said.text]);
    }
    for (; this.logged.Stepped < records.Stepped.length; this.logged.Stepped++) {
      const step = records.Stepped[this.logged.Stepped];
      const outcome = step.moved ? "" : " · no effect";
      const words = `${step.action} · ${holding(step.condition, terms)}${TAGS[this.reason(step)]}${outcome}`;
      lines.push([step.time, 0, "act", words, `Condition ${step.condition}: ${inWords(step.condition, terms).slice(3)}`]);
    }
    for (; this.logged.Learnt < records.Learnt.length; this.logged.Learnt++) {
      const now = records.Learnt[this.logged.Learnt];
      for (const [words, hint] of newRules(records.Learnt[this.logged.Learnt - 1], now, terms)) lines.push([now.time, 2, "rule", words, hint]);
    }
    for (; this.logged.Explored < records.Explored.length; this.logged.Explored++) {
      const { time, fraction } = records.Explored[this.logged.Explored];
      const reached = Math.floor(fraction / MAPPING_STEP + 1e-9);
      if (task === "localize" || reached <= this.mappedSteps || time >= this.trace.actsFrom) continue;
      this.mappedSteps = reached;
      const percent = Math.round(reached * MAPPING_STEP * 100);
      lines.push([time, 3, "said", task === "map" ? `Mapped ${percent} % of the log.` : `Mapped ${percent} %.`]);
    }
    if (!lines.length) return;
    lines.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const made = document.createDocumentFragment();
    for (const [time, , style, text, hint] of lines) {
      const node = make("li", `${style} later`, make("time", "", clockText(time - this.trace.begin)), make("span", "", text));
      if (hint) node.title = hint;
      const number = this.entries.length;
      node.addEventListener("click", () => {
        this.seek(time);
        this.chosen = number;
      });
      this.entries.push({ time, node });
      made.append(node);
    }
    element("log").append(made);
  }

  // Go to the previous or next line of the log.
  stepInLog(by) {
    const here = this.chosen >= 0 ? this.chosen : this.marked;
    const next = Math.min(Math.max(here + by, 0), this.entries.length - 1);
    if (next < 0) return;
    this.seek(this.entries[next].time);
    this.chosen = next;
    this.entries[next].node.scrollIntoView({ block: "nearest" });
  }

  // The estimated pose, for a robot of a log, which has no terms.
  updateEstimate(began, seen, pose) {
    element("estimate").hidden = Boolean(began.terms.length) || !seen;
    if (!seen || !this.changed("estimate", `${seen.time} ${pose}`)) return;
    const rows = [["x", metres(pose[0])], ["y", metres(pose[1])], ["heading", degrees(pose[2])]];
    const count = seen.particles.length / 3;
    if (count) rows.push(["particles", count], ["particle spread (rms)", metres(spreadOf(seen.particles))]);
    element("estimated").replaceChildren(...rows.flatMap(([name, value]) => [make("dt", "", name), make("dd", "", String(value))]));
  }

  // Show the attributes of the selected object.
  inspect(picked, scene) {
    const panel = element("inspector");
    const details = picked && scene.instant ? attributesOf(picked, scene) : null;
    panel.hidden = !details;
    if (!details) {
      this.shown.inspected = null;
      return;
    }
    const [title, colour, rows] = details;
    if (!this.changed("inspected", JSON.stringify(details))) return;
    const close = make("button", "icon", "×");
    close.setAttribute("aria-label", "Close");
    close.addEventListener("click", () => (scene.selected = null));
    const mark = make("i");
    mark.style.setProperty("--c", `var(${colour})`);
    const list = make("dl");
    for (const [name, value] of rows) list.append(make("dt", "", name), make("dd", "", String(value)));
    panel.replaceChildren(make("header", "", mark, make("span", "", title), close), list);
  }
}

// Rules that are new or changed since the model before, as [text, hint].
function newRules(before, now, terms) {
  const old = new Map((before?.rules ?? []).map(([action, condition, effect]) => [`${action} ${effect}`, condition]));
  return now.rules
    .filter(([action, condition, effect]) => old.get(`${action} ${effect}`) !== condition)
    .map(([action, condition, effect]) => {
      const was = old.get(`${action} ${effect}`);
      const hint = `${condition}${was ? `, was ${was}` : ""}: ${inWords(condition, terms)}`;
      return [`${action}: ${effect} ${inFewWords(condition, terms)}`, hint];
    });
}

// Root mean square distance of the particles from their mean, m.
function spreadOf(particles) {
  const count = particles.length / 3;
  const mean = [0, 0];
  for (let n = 0; n < particles.length; n += 3) for (const axis of [0, 1]) mean[axis] += particles[n + axis] / count;
  let square = 0;
  for (let n = 0; n < particles.length; n += 3) square += ((particles[n] - mean[0]) ** 2 + (particles[n + 1] - mean[1]) ** 2) / count;
  return Math.sqrt(square) * POSITION_STEP;
}

const metres = (value) => `${value.toFixed(2)} m`;
const degrees = (value) => `${((value * 180) / Math.PI).toFixed(0)}°`;

// Title, colour and attributes of an object; null if it is gone.
function attributesOf(picked, scene) {
  const { instant } = scene;
  const object = instant.perceived?.things.find((item) => item.name === (picked.kind === "robot" ? "robot" : picked.name));
  const values = Object.entries(object?.values ?? {}).map(([name, value]) => [`${object.kind.toLowerCase()}.${name}`, value]);
  const place = scene.placeOf(picked);
  const where = place ? [["map", `${metres(place.x)}, ${metres(place.y)}`]] : [];
  if (picked.kind === "robot") {
    const { seen, pose } = instant;
    if (!pose) return null;
    const rows = [["heading", degrees(pose[2])], ["latch", seen.loaded ? "holds a box" : "empty"], ["laser", `${seen.points.length / 2} points`]];
    if (seen.particles.length) rows.push(["particles", seen.particles.length / 3]);
    return ["Robot", "--robot", [...values, ...where, ...rows]];
  }
  if (picked.kind === "box" || picked.kind === "object") {
    if (!place && !object) return null;
    return [`${object?.kind ?? "Box"} ${picked.name ?? ""}`, "--box", [...values, ...where]];
  }
  if (picked.kind === "warehouse")
    return ["Warehouse", "--warehouse", [["warehouse.x", picked.cell[0]], ["warehouse.y", picked.cell[1]], ...where]];
  const percent = scene.map.percentAt(picked.x, picked.y);
  const rows = [...where, ["P(occupied)", percent === null ? "unknown" : `${percent} %`]];
  if (instant.cells) {
    const [x, y] = scene.cellAt(instant.cells, picked.x, picked.y);
    rows.unshift(["cell", `${x}, ${y}`]);
  }
  return [percent !== null && percent > 65 ? "Wall" : "Place", percent > 65 ? "--wall" : "--soft", rows];
}
