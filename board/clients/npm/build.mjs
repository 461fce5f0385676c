// Writes the npm package: node build.mjs [FOLDER]. It contains the modules that the probe serves.
import { execFileSync } from "node:child_process";
import { copyFileSync, cpSync, mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url)), out = resolve(process.argv[2] ?? ".");
const root = mkdtempSync(join(tmpdir(), "hemilux-npm-"));
try {
  for (const name of ["package.json", "index.d.ts", "three.d.ts", "README.md"]) copyFileSync(join(here, name), join(root, name));
  cpSync(join(here, "examples"), join(root, "examples"), { recursive: true });
  copyFileSync(join(here, "../../src/server/client.js"), join(root, "index.js"));
  copyFileSync(join(here, "../../src/server/three.js"), join(root, "three.js"));
  mkdirSync(out, { recursive: true });
  console.log(join(out, execFileSync("npm", ["pack", "--silent", "--pack-destination", out], { cwd: root, encoding: "utf8" }).trim()));
} catch (error) {
  console.error(`build.mjs: ${String(error.message).split("\n")[0]}`);
  process.exitCode = 1;
} finally {
  rmSync(root, { recursive: true });
}
