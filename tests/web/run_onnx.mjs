// Runs exported nets under onnxruntime-web (wasm), as a browser would: node run_onnx.mjs NODE_MODULES JOBS.json
//
// JOBS.json: [{"model": path, "guide": path, "shape": [n, g, h, w], "answer": path}, ...]; pictures are raw float32.
// Prints one JSON line: the version of the runtime and the shape of each answer.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const [modules, jobs] = process.argv.slice(2);
const require = createRequire(join(modules, "here.js"));
const ort = require("onnxruntime-web");
ort.env.wasm.numThreads = 1;

const shapes = [];
for (const { model, guide, shape, answer } of JSON.parse(readFileSync(jobs, "utf8"))) {
  // from bytes, as after a download: weights in a second file could not be found
  const session = await ort.InferenceSession.create(new Uint8Array(readFileSync(model)), {
    executionProviders: ["wasm"],
  });
  const bytes = readFileSync(guide);
  const values = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
  const { lightmap } = await session.run({ guide: new ort.Tensor("float32", values, shape) });
  const pixels = lightmap.data;
  writeFileSync(answer, new Uint8Array(pixels.buffer, pixels.byteOffset, pixels.byteLength));
  shapes.push(lightmap.dims);
  await session.release();
}
console.log(JSON.stringify({ version: ort.env.versions?.web, shapes }));
