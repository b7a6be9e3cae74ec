// @ts-check
/* Elements of the page: found, and made. */

/** Return an element of the page. @template {HTMLElement} T
 * @param {string} id @param {{new (): T}} [type] @returns {T} */
export function element(id, type) {
  const found = document.getElementById(id);
  if (!(found instanceof (type ?? HTMLElement))) throw new Error(`the page lacks #${id}`);
  return /** @type {T} */ (found);
}

/** @param {string} selector @param {ParentNode} within @returns {HTMLElement[]} */
export function elements(selector, within = document) { return Array.from(within.querySelectorAll(selector)).filter((each) => each instanceof HTMLElement); }

/** Return a new element. @template {keyof HTMLElementTagNameMap} K @param {K} tag
 * @param {Partial<HTMLElementTagNameMap[K]>} [properties] @param {(Node | string)[]} children
 * @returns {HTMLElementTagNameMap[K]} */
export function make(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}
