// Bundles the page: src/main.ts and styles/page.css to built/assets/ under names that hold their content's hash,
// and index.html that names them; and what Python puts into a report: one script and one style in built/report/.
// The licences of what is bundled lie beside.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "built");

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
const shared = {
  absWorkingDir: here,
  bundle: true,
  target: "es2022",
  minify: true,
  legalComments: "none",
  define: { "process.env.NODE_ENV": '"production"' },
};
const { metafile } = await build({
  ...shared,
  entryPoints: { page: "src/main.ts", style: "styles/page.css" },
  outdir: "built/assets",
  entryNames: "[name]-[hash]",
  chunkNames: "[name]-[hash]",
  splitting: true,
  format: "esm",
  loader: { ".webp": "file" },
  assetNames: "[name]-[hash]",
  publicPath: "/assets",
  metafile: true,
});
await build({ ...shared, entryPoints: { report: "src/report/main.ts", style: "styles/report.css" }, outdir: "built/report", format: "iife" });

const outputs = Object.entries(metafile.outputs);
const assetOf = (entry) => {
  const found = outputs.find(([, told]) => told.entryPoint === entry);
  if (found === undefined) throw new Error(`esbuild wrote nothing for ${entry}`);
  return found[0].replace(/^built\//, "");
};

/** Name, version and licence texts of a package of npm's. */
const licencesOf = async (name) => {
  const folder = join(here, "node_modules", name);
  const { version, license } = JSON.parse(await readFile(join(folder, "package.json"), "utf8"));
  const named = (await readdir(folder, { withFileTypes: true })).filter((entry) => /^(licen[cs]e|notice)/i.test(entry.name));
  const inside = named.filter((entry) => entry.isDirectory()).map(async ({ name: place }) =>
    (await readdir(join(folder, place))).map((file) => join(place, file)));
  const files = [...named.filter((entry) => entry.isFile()).map((entry) => entry.name), ...(await Promise.all(inside)).flat()].sort();
  if (files.length === 0) throw new Error(`${name} has no licence file`);
  const texts = await Promise.all(files.map((file) => readFile(join(folder, file), "utf8")));
  return `${name} ${version} (${license})\n\n${texts.join("\n")}`;
};
const packages = new Set(
  Object.keys(metafile.inputs).flatMap((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)\//)?.[1] ?? []),
);
const notices = (await Promise.all([...packages].sort().map(licencesOf))).join(`\n${"=".repeat(72)}\n\n`);
const licences = `assets/licences-${createHash("sha256").update(notices).digest("hex").slice(0, 8)}.txt`;
await writeFile(join(out, licences), notices);
await writeFile(join(out, "report", "licences.txt"), notices);

const template = await readFile(join(here, "index.html"), "utf8");
const page = template
  .replace("STYLE", assetOf("styles/page.css"))
  .replace("SCRIPT", assetOf("src/main.ts"))
  .replace("LICENCES", licences);
await writeFile(join(out, "index.html"), page);
