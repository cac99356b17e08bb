/**
 * The documents as pages: what a page's Help opens. Links lead to the other documents, and to what is no part of the
 * service nowhere; of the pictures there are the drawings.
 */
import { copyFileSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { Marked, type Tokens } from "marked";

/** As GitHub makes it of a heading, so that links in the documents hold. */
const anchor = (heading: string): string =>
  heading
    .toLowerCase()
    .replace(/[^\p{L}\p{N}_ -]/gu, "")
    .replace(/ /g, "-");

const marked = new Marked({
  renderer: {
    heading({ tokens, depth, text }: Tokens.Heading): string {
      return `<h${depth} id="${anchor(text.replace(/[`*]/g, ""))}">${this.parser.parseInline(tokens)}</h${depth}>\n`;
    },
    link({ href, tokens }: Tokens.Link): string {
      const text = this.parser.parseInline(tokens);
      if (/^(#|https?:)/.test(href)) return `<a href="${href}">${text}</a>`;
      const other = /^([a-z-]+)\.md(#.*)?$/.exec(href);
      return other ? `<a href="${other[1] ?? ""}.html${other[2] ?? ""}">${text}</a>` : text;
    },
    image({ href, text }: Tokens.Image): string {
      return href.endsWith(".svg") ? `<img src="${href}" alt="${text}">` : "";
    },
    table({ header, rows }: Tokens.Table): string {
      const line = (cells: Tokens.TableCell[], tag: string): string =>
        `<tr>${cells.map(({ tokens }) => `<${tag}>${this.parser.parseInline(tokens)}</${tag}>`).join("")}</tr>`;
      const body = rows.map((cells) => line(cells, "td")).join("");
      return `<div class="scroll"><table><thead>${line(header, "th")}</thead><tbody>${body}</tbody></table></div>\n`;
    },
  },
});

const page = (title: string, body: string, others: string): string => `<!doctype html>
<html lang="en">
  <head>
    <meta charset="utf-8">
    <meta name="viewport" content="width=device-width, initial-scale=1">
    <title>${title} · apexcal</title>
    <link rel="stylesheet" href="/help.css">
  </head>
  <body>
    <main>${body}</main>
    <nav aria-label="All documents">${others}</nav>
  </body>
</html>
`;

/** Write a page for each document in `from`, and the drawings, into `into`. */
export function writeHelp(from: string, into: string): void {
  mkdirSync(`${into}/images`, { recursive: true });
  for (const name of readdirSync(`${from}/images`).filter((each) => each.endsWith(".svg"))) {
    copyFileSync(`${from}/images/${name}`, `${into}/images/${name}`);
  }
  const documents = readdirSync(from)
    .filter((name) => name.endsWith(".md"))
    .map((name) => {
      const text = readFileSync(`${from}/${name}`, "utf8");
      const title = /^# (.+)$/m.exec(text)?.[1]?.replace(/[`*]/g, "") ?? name;
      return { name: name.replace(".md", ".html"), text, title };
    });
  const links = documents.map(({ name, title }) => `<a href="${name}">${title}</a>`).join("\n");
  for (const { name, text, title } of documents) {
    writeFileSync(`${into}/${name}`, page(title, marked.parse(text, { async: false }), links));
  }
}
