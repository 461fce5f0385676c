// Prints the report of gltf-validator for each file, and fails if a file has errors or warnings. Packages come from NODE_PATH.
const fs = require("node:fs");
const validator = require("gltf-validator");

async function check(path) {
  const { issues } = await validator.validateBytes(new Uint8Array(fs.readFileSync(path)));
  console.log(`${path.split("/").at(-1)}: ${issues.numErrors} errors, ${issues.numWarnings} warnings`);
  for (const issue of issues.messages.slice(0, 5)) console.log(`  ${issue.code} ${issue.pointer}: ${issue.message}`);
  return issues.numErrors + issues.numWarnings;
}

Promise.all(process.argv.slice(2).map(check)).then(counts => process.exit(counts.some(n => n > 0) ? 1 : 0));
