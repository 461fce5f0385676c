// ESLint rules for the page, the clients and the scripts of the browser tests. HEMILUX_NODE is the folder of the npm packages (`.ci/run`).
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
  // This rule reports members whose only use is `this.#due ||= f()`.
  "no-unused-private-class-members": "off",
  "prefer-const": ["error", { destructuring: "all" }],
};

export default [
  { files: ["board/**/*.js"], languageOptions: { ecmaVersion: 2024, globals: globals.browser }, rules },
  // The browser runs the functions that the tests pass to `page.evaluate`, so that browser globals are allowed as well.
  { files: ["board/**/*.mjs", "tests/**/*.mjs", ".ci/*.mjs"], languageOptions: { ecmaVersion: 2024, globals: { ...globals.browser, ...globals.node } }, rules },
];
