// Rules for the page, the clients and the scripts that drive the browser. Packages come from HEMILUX_NODE, see `.ci/run`.
import { createRequire } from "node:module";

const packages = createRequire(`${process.env.HEMILUX_NODE}/`);
const js = packages("@eslint/js"), globals = packages("globals");

const rules = {
  ...js.configs.recommended.rules,
  "default-case-last": "error",
  eqeqeq: "error",
  "no-constant-binary-expression": "error",
  "no-implied-eval": "error",
  "no-unused-vars": "error",
  "no-var": "error",
  "object-shorthand": "error",
  // Takes `this.#due ||= f()` for no use.
  "no-unused-private-class-members": "off",
  "prefer-const": ["error", { destructuring: "all" }],
};

export default [
  { files: ["board/**/*.js"], languageOptions: { ecmaVersion: 2024, globals: globals.browser }, rules },
  // What the scripts of the tests hand to `page.evaluate` runs in the browser.
  { files: ["board/**/*.mjs", "tests/**/*.mjs", ".ci/*.mjs"], languageOptions: { ecmaVersion: 2024, globals: { ...globals.browser, ...globals.node } }, rules },
];
