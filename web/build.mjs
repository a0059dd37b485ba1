// SPDX-License-Identifier: BSD-3-Clause
// Bundle the page into the folder from which `rockfall app` serves it: three files and the licences of the bundled packages.
import { build } from 'esbuild';
import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, renameSync, rmSync, writeFileSync } from 'node:fs';
import { dirname, join, sep } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = dirname(fileURLToPath(import.meta.url));
const page = process.argv[2] ?? join(here, '..', 'python', 'rockfall', 'app', 'page');

/** Text of the licence of a package in node_modules. */
function licenceOf(name) {
  const folder = join(here, 'node_modules', ...name.split('/'));
  const about = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
  const file = readdirSync(folder).find((one) => /^licen[cs]e/i.test(one));
  const text = file ? readFileSync(join(folder, file), 'utf8').trim() : `Licence: ${about.license}`;
  return `${name} ${about.version}\n\n${text}\n`;
}

/** Names of the packages whose files went into a bundle. */
function packagesOf(inputs) {
  const paths = Object.keys(inputs).filter((path) => path.includes('node_modules/')).map((path) => path.split('node_modules/').at(-1));
  return [...new Set(paths.map((path) => path.split('/').slice(0, path.startsWith('@') ? 2 : 1).join('/')))].sort();
}

const result = await build({
  absWorkingDir: here,
  entryPoints: { app: 'src/main.ts' },
  outdir: `${page}.new`,
  bundle: true,
  minify: true,
  format: 'iife',
  target: ['es2022'],
  metafile: true,
  legalComments: 'none', // all licences are in licences.txt
  logLevel: 'warning',
});
mkdirSync(`${page}.new`, { recursive: true });
copyFileSync(join(here, 'index.html'), join(`${page}.new`, 'index.html'));
writeFileSync(join(`${page}.new`, 'licences.txt'), packagesOf(result.metafile.inputs).map(licenceOf).join(`\n${'-'.repeat(80)}\n\n`));
if (existsSync(page)) rmSync(page, { recursive: true });
renameSync(`${page}.new`, page);
for (const [path, { bytes }] of Object.entries(result.metafile.outputs)) console.log(`${path.split(sep).at(-1)}: ${(bytes / 1024).toFixed(0)} kB`);
