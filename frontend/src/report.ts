/** The report of one result: the result page with its data inside, in one file that loads nothing. */

import { mount } from "svelte";
import "./app.css";
import Report from "./pages/calibration/Report.svelte";
import type { ReportDocument } from "./lib/report.ts";

/** The document as a worker wrote it: JSON, gzipped, in base64, which no name in it can leave. */
async function read(): Promise<ReportDocument> {
  const bytes = Uint8Array.from(atob(document.getElementById("data")?.textContent ?? ""), (one) => one.charCodeAt(0));
  const text = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return (await new Response(text).json()) as ReportDocument;
}

const target = document.getElementById("app");
if (!target) throw new Error("report.html has no #app");
read().then(
  (report) => mount(Report, { target, props: { report } }),
  () => (target.textContent = "This report is damaged: it ends early. Load or make it again."),
);
