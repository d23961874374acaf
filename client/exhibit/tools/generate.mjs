// Generates src/gen from the .proto files with Debian's protoc and the plugin of node_modules.
import { execFileSync } from "node:child_process";
import { mkdirSync, rmSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(dirname(fileURLToPath(import.meta.url)));
const protos = join(here, "../../proto");
const out = join(here, "src/gen");
rmSync(out, { recursive: true, force: true });
mkdirSync(out, { recursive: true });
execFileSync(
  process.env.PROTOC ?? "protoc",
  [
    `--proto_path=${protos}`,
    `--plugin=protoc-gen-es=${join(here, "node_modules/.bin/protoc-gen-es")}`,
    `--es_out=${out}`,
    "--es_opt=target=ts",
    ...["v1/types", "v1/pose", "v1/capture_service", "v1/stream_service", "web/v1/exhibit"].map(
      (name) => `kinevox/${name}.proto`,
    ),
  ],
  { stdio: "inherit" },
);
