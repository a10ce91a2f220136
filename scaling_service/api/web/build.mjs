// Bundles the page: src/main.ts and styles/page.css to built/assets/ under names that hold their content's hash,
// and index.html that names them.
import { build } from "esbuild";
import { mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "built");

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
const { metafile } = await build({
  absWorkingDir: here,
  entryPoints: { page: "src/main.ts", style: "styles/page.css" },
  outdir: "built/assets",
  entryNames: "[name]-[hash]",
  chunkNames: "[name]-[hash]",
  bundle: true,
  splitting: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "linked",
  metafile: true,
  define: { "process.env.NODE_ENV": '"production"' },
});

const outputs = Object.entries(metafile.outputs);
const assetOf = (entry) => {
  const found = outputs.find(([, told]) => told.entryPoint === entry);
  if (found === undefined) throw new Error(`esbuild wrote nothing for ${entry}`);
  return found[0].replace(/^built\//, "");
};
const template = await readFile(join(here, "index.html"), "utf8");
const page = template
  .replace("STYLE", assetOf("styles/page.css"))
  .replace("SCRIPT", assetOf("src/main.ts"));
await writeFile(join(out, "index.html"), page);
