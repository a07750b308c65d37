"use strict";
// The panels beside the map: condition, rules, unknown pairs, boxes, log, and attributes of the selection.

const MAPPING_STEP = 0.2; // fraction of the area, or of the log, between two lines about mapping progress
const MAX_BOX_SYMBOLS = 40;
const WALL_PERCENT = 65; // P(occupied) in percent above which a point of the map is called a wall

// A term without its first argument, the robot or taxi, which all terms share: "touch_N(wall)".
const shortTerm = (term) => term.replace(/\((robot|taxi), /, "(");

const termName = (terms, index) => terms[index] ?? `term ${index + 1}`;

// Names of the terms that are true in a condition.
function trueTerms(condition, terms) {
  const names = [...condition].flatMap((bit, index) => (bit === "1" ? [shortTerm(termName(terms, index))] : []));
  return names.length ? names.join(", ") : "no term holds";
}

const PHASES = { explore: "Explores", localize: "Localizes", survey: "Looks for boxes", learn: "Learns", deliver: "Delivers", map: "Maps", done: "Done" };
const phaseName = (phase, run) => (phase === "deliver" && run.task === "learn" ? "Uses its rules" : PHASES[phase]) ?? phase ?? "";
// Explanation of an action, and its tag in the log, by the purpose of the action.
const EXPLANATIONS = {
  plan: "Part of its plan: the outcome is known.",
  experiment: "An experiment: the outcome is unknown under this condition.",
  approach: "On the way to an experiment: the action leads to a condition with an unknown outcome.",
};
const TAGS = { plan: "", experiment: " · experiment", approach: " · to an experiment" };
const SVG = "http://www.w3.org/2000/svg";

function clockText(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const minutes = Math.floor(whole / 60);
  return `${minutes}:${String(whole % 60).padStart(2, "0")}`;
}

// The bits of a condition; a star (either) is shown paler.
function bitPattern(condition) {
  const made = make("code", "pattern");
  for (const bit of condition) made.append(make(bit === "*" ? "i" : "b", "", bit));
  return made;
}

// A condition as a conjunction of terms: "if touch_N(wall) and not in_bot", or "always".
function conjunction(condition, terms) {
  const literals = [...condition].flatMap((bit, index) => (bit === "*" ? [] : [(bit === "1" ? "" : "not ") + termName(terms, index)]));
  return literals.length ? "if " + literals.join(" and ") : "always";
}

// A shorter form of the same: of a condition without stars, only the true terms are named.
function shortConjunction(condition, terms) {
  if (condition.includes("*")) return conjunction(condition, terms.map(shortTerm));
  return condition.includes("1") ? `if only ${trueTerms(condition, terms)}` : "if no term holds";
}

// Whether a condition, which may have stars, covers a condition without stars.
const covers = (condition, bits) => [...condition].every((bit, index) => bit === "*" || bit === bits[index]);

class Panels {
  constructor(trace, seek) {
    this.trace = trace;
    this.seek = seek;
    this.clear();
  }

  clear() {
    this.logged = { Narration: 0, StepTaken: 0, LearntModel: 0, MapUpdate: 0 }; // number of logged records by type
    this.mappedSteps = 0; // logged mapping progress, in units of MAPPING_STEP
    this.entries = []; // {time, node} of each line of the log
    this.clicked = -1; // index of the clicked entry, while its time is shown
    this.latest = -1; // index of the last entry that is not later than the shown time
    this.shown = {}; // values of the last update, by name
    element("log").replaceChildren();
    element("bits").replaceChildren();
  }

  // Whether a value differs from that of the previous call with the same name.
  changed(name, value) {
    if (this.shown[name] === value) return false;
    this.shown[name] = value;
    return true;
  }

  update(time) {
    const { trace } = this;
    const run = trace.records.RunStarted[0];
    if (!run) return;
    const step = trace.at("StepTaken", time);
    const perceived = trace.at("PerceivedState", time);
    const model = trace.at("LearntModel", time);
    const condition = perceived?.condition ?? step?.condition;
    this.updateTitle(run, time);
    this.updateNow(time);
    this.updateBits(run, condition);
    this.updateRules(run, model, condition, time);
    this.updateProgress(step, perceived, time);
    this.updateExplored(trace.at("MapUpdate", time), Boolean(step) || run.task === "localize");
    this.updateLog(time);
  }

  updateTitle(run, time) {
    if (this.changed("title", run)) element("subject").textContent = `${run.task} · ${run.subject}`;
    const phases = this.trace.phases();
    const phase = phases[lastNotAfter(phases, time, (band) => band.time)]?.phase;
    if (this.changed("phase", phase)) {
      element("phase").hidden = !phase;
      element("phase").textContent = phaseName(phase, run);
      element("phase").style.setProperty("--phase", `var(--${phase}-phase)`);
    }
  }

  // The action in progress or, before the robot acts and after it is done, the last narration.
  updateNow(time) {
    const { trace } = this;
    const steps = trace.records.StepTaken;
    const next = steps[trace.indexAt("StepTaken", time) + 1] ?? steps.at(-1);
    const acting = next && time >= trace.actsFrom && !this.isDone(time);
    const narration = trace.at("Narration", time);
    if (!this.changed("now", acting ? next : narration)) return;
    const action = element("action");
    action.hidden = !acting;
    if (acting) {
      action.textContent = next.action;
      action.dataset.learning = next.learning;
      element("why").textContent = EXPLANATIONS[this.purpose(next)];
    } else element("why").textContent = narration?.text ?? "";
  }

  // Purpose of a step: "plan", "experiment" (no rule or failure condition predicts it), or "approach" to an experiment.
  purpose(step) {
    if (!step.learning) return "plan";
    const model = this.trace.at("LearntModel", step.time - 1e-3); // the one before the step
    const predictions = [...(model?.rules ?? []), ...(model?.failures[step.action] ?? []).map((condition) => [step.action, condition])];
    return predictions.some(([action, condition]) => action === step.action && covers(condition, step.condition)) ? "approach" : "experiment";
  }

  isDone(time) {
    return this.trace.at("Narration", time)?.phase === "done";
  }

  updateBits(run, condition) {
    element("symbols").hidden = !run.terms.length;
    if (!run.terms.length || !this.changed("bits", condition ?? null)) return;
    const list = element("bits");
    if (!list.children.length)
      for (const term of run.terms) {
        const name = make("span", "", shortTerm(term));
        name.title = term;
        list.append(make("li", "", make("b", "", "0"), name));
      }
    element("condition").textContent = condition ?? "";
    [...list.children].forEach((item, index) => {
      const bit = condition?.[index];
      const state = bit === undefined ? "unknown" : bit === "1" ? "holds" : "does not hold";
      item.classList.toggle("on", bit === "1");
      item.firstChild.textContent = bit ?? "–";
      item.setAttribute("aria-label", `${run.terms[index]}: ${state}`);
    });
  }

  updateRules(run, model, condition, time) {
    element("knowledge").hidden = !run.terms.length;
    if (!run.terms.length) return;
    const rulesChanged = this.changed("learnt", model);
    if (!rulesChanged && !this.changed("applies", condition)) return;
    this.shown.applies = condition;
    if (rulesChanged) this.makeRules(run, model, time);
    for (const item of element("rules").querySelectorAll("[data-condition]")) {
      const applies = condition !== undefined && covers(item.dataset.condition, condition);
      item.classList.toggle("applies", applies);
      item.title = applies ? "Applies now: its condition holds" : "Does not apply now";
    }
    for (const item of element("rules").querySelectorAll("[data-failure]")) item.classList.toggle("on", item.dataset.failure === condition);
  }

  makeRules(run, model, time) {
    const open = new Set([...element("rules").querySelectorAll("details[open]")].map((item) => item.dataset.action));
    const previous = new Set(this.ruleKeys ?? []);
    const fresh = this.rulesTime !== undefined && time >= this.rulesTime;
    const rules = model?.rules ?? [];
    const failures = model?.failures ?? {};
    this.rulesTime = time;
    this.ruleKeys = rules.map((rule) => rule.join(" "));
    const items = run.actions.flatMap((action) => {
      const made = rules.filter((rule) => rule[0] === action).map(([, condition, effect]) => {
        const item = this.ruleItem(action, condition, effect, run.terms);
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
    const top = make("div", "rule-top", make("b", "", action), make("span", "", effect), bitPattern(condition));
    const item = make("li", "", top, make("div", "rule-when", conjunction(condition, terms.map(shortTerm))));
    item.dataset.condition = condition;
    return item;
  }

  failureList(action, conditions, open) {
    const summary = make("summary", "", `no effect in ${conditions.length}`);
    summary.title = `Number of conditions in which ${action} is known to have no effect; press to list them`;
    const items = conditions.map((condition) => {
      const { terms } = this.trace.records.RunStarted[0];
      const item = make("span", "", shortConjunction(condition, terms));
      item.title = `${condition}: ${conjunction(condition, terms)}`;
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
    const steps = this.trace.records.StepTaken;
    const [isOtherStep, hasNewSteps] = [this.changed("step", step), this.changed("steps", steps.length)];
    if (isOtherStep || hasNewSteps) this.drawChart(steps, this.trace.indexAt("StepTaken", time));
    const held = perceived?.objects.some(({ attributes }) => attributes.in_bot) ? 1 : 0;
    if (!this.changed("boxes", `${step.delivered} ${step.remaining} ${held}`)) return;
    const total = step.delivered + step.remaining;
    if (this.trace.records.RunStarted[0].task === "learn") {
      element("counted").textContent = "Episodes";
      element("delivered").textContent = step.delivered;
      return;
    }
    element("delivered").textContent = `${step.delivered} of ${total}`;
    element("boxes").setAttribute("aria-label", `${step.delivered} of ${total} boxes delivered, ${held} in the fork`);
    element("boxes").replaceChildren(
      ...Array.from({ length: Math.min(total, MAX_BOX_SYMBOLS) }, (_, index) => make("i", index < step.delivered ? "done" : index < step.delivered + held ? "held" : "")),
    );
  }

  // The number of unknown pairs after each action as a step chart; the future is shown paler.
  drawChart(steps, current) {
    const maximum = Math.max(1, ...steps.map((step) => step.unknown));
    const width = Math.max(steps.length - 1, 1);
    const point = (index) => [(160 * index) / width, 53 - (48 * steps[index].unknown) / maximum];
    const line = (from, to) => {
      let path = "";
      for (let index = from; index <= to; index++) {
        const [x, y] = point(index);
        path += index === from ? `M${x.toFixed(1)} ${y.toFixed(1)}` : `H${x.toFixed(1)}V${y.toFixed(1)}`;
      }
      return path;
    };
    const shape = (tag, attributes) => {
      const made = document.createElementNS(SVG, tag);
      for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
      return made;
    };
    const done = line(0, current);
    element("chart").replaceChildren(
      shape("line", { x1: 0, x2: 160, y1: 53, y2: 53 }),
      shape("path", { class: "area", d: `${done}V53H0Z` }),
      shape("path", { class: "rest", d: line(current, steps.length - 1) }),
      shape("path", { d: done }),
    );
    element("unknown").textContent = steps[current].unknown;
  }

  updateExplored(update, isExplored) {
    const fraction = update && !isExplored ? update.fraction : null;
    if (!this.changed("explored", fraction)) return;
    element("exploring").hidden = fraction === null;
    element("exploring-name").textContent = this.trace.records.RunStarted[0].task === "map" ? "Mapped part of the log" : "Explored";
    const percent = Math.round((fraction ?? 0) * 100);
    element("explored").textContent = `${percent} %`;
    element("meter").setAttribute("aria-valuenow", percent);
    element("meter").firstElementChild.style.width = `${percent}%`;
  }

  updateLog(time) {
    this.extendLog();
    const last = lastNotAfter(this.entries, time, (entry) => entry.time);
    if (this.clicked >= 0 && Math.abs(this.entries[this.clicked].time - time) > 1e-6) this.clicked = -1;
    const current = this.clicked >= 0 ? this.clicked : last;
    if (!this.changed("log", `${current} ${last} ${this.entries.length}`)) return;
    const list = element("log");
    list.querySelector(".here")?.classList.remove("here");
    for (let index = Math.min(this.latest, last) + 1; index <= Math.max(this.latest, last); index++)
      this.entries[index].node.classList.toggle("later", index > last);
    this.latest = last;
    const node = this.entries[current]?.node;
    if (!node) return;
    node.classList.add("here");
    if (list.matches(":hover") || document.activeElement === list) return;
    const above = Math.max(0, Math.min(list.clientHeight * 0.7, list.clientHeight - node.offsetHeight)); // px of earlier lines
    list.scrollTop = node.offsetTop - list.offsetTop - above;
  }

  // Append new narrations, actions, rules and mapping progress to the log, in order of time.
  extendLog() {
    const { records } = this.trace;
    const { terms, task } = records.RunStarted[0];
    const lines = []; // [time, rank among lines of the same time, class, text, hint]
    for (; this.logged.Narration < records.Narration.length; this.logged.Narration++) {
      const narration = records.Narration[this.logged.Narration];
      lines.push([narration.time, 1, "said", narration.text]);
    }
    for (; this.logged.StepTaken < records.StepTaken.length; this.logged.StepTaken++) {
      const step = records.StepTaken[this.logged.StepTaken];
      const outcome = step.moved ? "" : " · no effect";
      const text = `${step.action} · ${trueTerms(step.condition, terms)}${TAGS[this.purpose(step)]}${outcome}`;
      lines.push([step.time, 0, "act", text, `Condition ${step.condition}: ${conjunction(step.condition, terms).slice(3)}`]);
    }
    for (; this.logged.LearntModel < records.LearntModel.length; this.logged.LearntModel++) {
      const model = records.LearntModel[this.logged.LearntModel];
      const previous = records.LearntModel[this.logged.LearntModel - 1];
      for (const [text, hint] of newRules(previous, model, terms)) lines.push([model.time, 2, "rule", text, hint]);
    }
    for (; this.logged.MapUpdate < records.MapUpdate.length; this.logged.MapUpdate++) {
      const { time, fraction } = records.MapUpdate[this.logged.MapUpdate];
      const reached = Math.floor(fraction / MAPPING_STEP + 1e-9);
      if (task === "localize" || reached <= this.mappedSteps || time >= this.trace.actsFrom) continue;
      this.mappedSteps = reached;
      const percent = Math.round(reached * MAPPING_STEP * 100);
      lines.push([time, 3, "said", task === "map" ? `Mapped ${percent} % of the log.` : `Mapped ${percent} %.`]);
    }
    if (!lines.length) return;
    lines.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const made = document.createDocumentFragment();
    for (const [time, , className, text, hint] of lines) {
      const node = make("li", `${className} later`, make("time", "", clockText(time - this.trace.begin)), make("span", "", text));
      if (hint) node.title = hint;
      const index = this.entries.length;
      node.addEventListener("click", () => {
        this.seek(time);
        this.clicked = index;
      });
      this.entries.push({ time, node });
      made.append(node);
    }
    element("log").append(made);
  }

  // Go to the next (direction 1) or previous (-1) line of the log.
  stepInLog(direction) {
    const current = this.clicked >= 0 ? this.clicked : this.latest;
    const next = Math.min(Math.max(current + direction, 0), this.entries.length - 1);
    if (next < 0) return;
    this.seek(this.entries[next].time);
    this.clicked = next;
    this.entries[next].node.scrollIntoView({ block: "nearest" });
  }

  // The estimated pose of a recorded log, whose runs have no terms.
  updateEstimate(run, snapshot, pose) {
    element("estimate").hidden = Boolean(run.terms.length) || !snapshot;
    if (!snapshot || !this.changed("estimate", `${snapshot.time} ${pose}`)) return;
    const rows = [["x", metres(pose[0])], ["y", metres(pose[1])], ["heading", degrees(pose[2])]];
    const count = snapshot.particles.length / 3;
    if (count) rows.push(["particles", count], ["particle spread (rms)", metres(spreadOf(snapshot.particles))]);
    element("estimated").replaceChildren(...rows.flatMap(([name, value]) => [make("dt", "", name), make("dd", "", String(value))]));
  }

  // Show the attributes of the selection.
  inspect(selection, scene) {
    const panel = element("inspector");
    const details = selection && scene.instant ? attributesOf(selection, scene) : null;
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
    const list = make("dl");
    for (const [name, value] of rows) list.append(make("dt", "", name), make("dd", "", String(value)));
    panel.replaceChildren(make("header", "", swatch(`var(${colour})`), make("span", "", title), close), list);
  }
}

// Rules that are new or changed since the previous model, as [text, hint].
function newRules(previous, model, terms) {
  const old = new Map((previous?.rules ?? []).map(([action, condition, effect]) => [`${action} ${effect}`, condition]));
  return model.rules
    .filter(([action, condition, effect]) => old.get(`${action} ${effect}`) !== condition)
    .map(([action, condition, effect]) => {
      const was = old.get(`${action} ${effect}`);
      const hint = `${condition}${was ? `, was ${was}` : ""}: ${conjunction(condition, terms)}`;
      return [`${action}: ${effect} ${shortConjunction(condition, terms)}`, hint];
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

// Title, colour and attributes of a selection; null if the object does not exist any more.
function attributesOf(selection, scene) {
  const { instant } = scene;
  const object = instant.perceived?.objects.find((item) => item.name === (selection.kind === "robot" ? "robot" : selection.name));
  const attributes = Object.entries(object?.attributes ?? {}).map(([name, value]) => [`${object.className.toLowerCase()}.${name}`, value]);
  const location = scene.locate(selection);
  const position = location ? [["map", `${metres(location.x)}, ${metres(location.y)}`]] : [];
  if (selection.kind === "robot") {
    const { snapshot, pose } = instant;
    if (!pose) return null;
    const rows = [["heading", degrees(pose[2])], ["latch", snapshot.loaded ? "holds a box" : "empty"], ["laser", `${snapshot.points.length / 2} points`]];
    if (snapshot.particles.length) rows.push(["particles", snapshot.particles.length / 3]);
    return ["Robot", "--robot", [...attributes, ...position, ...rows]];
  }
  if (selection.kind === "box" || selection.kind === "object") {
    if (!location && !object) return null;
    return [`${object?.className ?? "Box"} ${selection.name ?? ""}`, "--box", [...attributes, ...position]];
  }
  if (selection.kind === "warehouse")
    return ["Warehouse", "--warehouse", [["warehouse.x", selection.cell[0]], ["warehouse.y", selection.cell[1]], ...position]];
  const percent = scene.map.percentAt(selection.x, selection.y);
  const rows = [...position, ["P(occupied)", percent === null ? "unknown" : `${percent} %`]];
  if (instant.cells) {
    const [x, y] = scene.cellAt(instant.cells, selection.x, selection.y);
    rows.unshift(["cell", `${x}, ${y}`]);
  }
  return percent > WALL_PERCENT ? ["Wall", "--wall", rows] : ["Point", "--soft", rows];
}
