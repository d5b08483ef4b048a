// Prints one JSON line a file: the Khronos validator's counts and its messages in short.
const fs = require('fs');
const validator = require('gltf-validator');

async function judge(file) {
  const bytes = new Uint8Array(fs.readFileSync(file));
  const { issues } = await validator.validateBytes(bytes, { uri: file, maxIssues: 1000 });
  const told = new Map();
  for (const m of issues.messages) {
    const first = told.get(m.code) ?? { count: 0, text: `${m.code} ${m.pointer ?? ''} ${m.message}` };
    told.set(m.code, { ...first, count: first.count + 1 });
  }
  const messages = [...told.values()].map((m) => `${m.count} x ${m.text}`);
  const { numErrors: errors, numWarnings: warnings, numInfos: infos } = issues;
  console.log(JSON.stringify({ file, errors, warnings, infos, messages }));
}

(async () => {
  for (const file of process.argv.slice(2)) await judge(file);
})();
