"""The widgets' scripts in node, without a browser: a page that is just enough for them to draw on."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

_PAGE = """
class Thing {
  constructor(tag) {
    Object.assign(this, { tag, dataset: {}, attributes: {}, childNodes: [], listeners: {}, textContent: "" });
    this.style = {};
    this.classList = { toggle() {}, add() {}, remove() {} };
    this.clientWidth = 640;
    this.captured = new Set();
  }
  get lastChild() { return this.childNodes.at(-1); }
  get children() { return this.childNodes; }
  appendChild(node) { this.childNodes.push(node); node.parent = this; return node; }
  replaceChildren(...nodes) { this.childNodes = nodes; }
  after(node) {
    const siblings = this.parent.childNodes;
    siblings.splice(siblings.indexOf(this) + 1, 0, node);
    node.parent = this.parent;
  }
  remove() { this.parent.childNodes = this.parent.childNodes.filter((node) => node !== this); }
  setAttribute(name, value) { this.attributes[name] = String(value); }
  getAttribute(name) { return this.attributes[name] ?? null; }
  removeAttribute(name) { delete this.attributes[name]; }
  addEventListener(name, action) { this.listeners[name] = action; }
  hasPointerCapture(id) { return this.captured.has(id); }
  getBoundingClientRect() { return { left: 0, top: 0, width: 640, height: 480 }; }
  getScreenCTM() { return { inverse: () => this.attributes.viewBox.split(" ").map(Number) }; }
  setPointerCapture(id) { this.captured.add(id); }
  contains() { return false; }
  closest(selector) {
    if (selector === `.${this.attributes.class}`) return this;
    return this.parent?.closest(selector) ?? null;
  }
  querySelector() { return new Thing("path"); }
  focus() {}
  of(name) {
    const own = this.attributes.class === name || this.className === name ? [this] : [];
    return [...own, ...this.childNodes.flatMap((node) => node.of(name))];
  }
}
globalThis.document = { createElement: (tag) => new Thing(tag), createElementNS: (_, tag) => new Thing(tag) };
globalThis.ResizeObserver = class { observe() {} disconnect() {} };
globalThis.Image = class { decode() { return Promise.resolve(); } };
// A pixel of the screen is one of the view that fills 640 x 480 of them.
globalThis.DOMPoint = class {
  constructor(x, y) { Object.assign(this, { x, y }); }
  matrixTransform([left, top, width, height]) {
    return { x: left + (this.x * width) / 640, y: top + (this.y * height) / 480 };
  }
};
export const waiting = [];
globalThis.requestAnimationFrame = (action) => waiting.push(action);
globalThis.cancelAnimationFrame = (number) => (waiting[number - 1] = () => {});
export const nextFrame = () => waiting.splice(0).forEach((action) => action());
export class Model {
  constructor(state) { Object.assign(this, { state, actions: {}, saved: 0, sent: [] }); }
  get(name) { return this.state[name]; }
  set(name, value) { this.state[name] = value; }
  save_changes() { this.saved++; }
  send(message) { this.sent.push(message); }
  on(name, action) { (this.actions[name] ??= []).push(action); }
  off(name, action) { this.actions[name] = (this.actions[name] ?? []).filter((one) => one !== action); }
  change(name, value) { this.set(name, value); (this.actions[`change:${name}`] ?? []).forEach((action) => action()); }
  get listeners() { return Object.values(this.actions).flat().length; }
}
export const page = () => new Thing("div");
export const bytes = (...values) => new DataView(new Float32Array(values).buffer);
"""


def in_node(folder: Path, module: object, trial: str) -> Any:
    """What a trial tells by `tell(...)`, once; it finds the module's default export as `widget`, and the page's names.

    Skips the test without node. A script that hangs fails.
    """
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    (folder / "page.mjs").write_text(_PAGE, encoding="utf-8")
    (folder / "widget.mjs").write_text(str(module), encoding="utf-8")
    head = 'import { Model, bytes, nextFrame, page } from "./page.mjs";\nimport widget from "./widget.mjs";\n'
    tell = "const tell = (what) => (console.log(JSON.stringify(what)), process.exit(0));\n"
    (folder / "trial.mjs").write_text(head + tell + trial, encoding="utf-8")
    done = subprocess.run([node, "trial.mjs"], cwd=folder, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
