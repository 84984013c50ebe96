// The API reference as one page without a script, from schema/openapi.yaml.

const METHODS = ["get", "head", "post", "put", "patch", "delete"];

const escaped = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll('"', "&quot;");
const inline = (text) => escaped(text).replaceAll(/`([^`]+)`/g, "<code>$1</code>");

/** The little Markdown that the document uses: paragraphs and code. */
function prose(text) {
  return (text ?? "")
    .trim()
    .split(/\n\s*\n/)
    .filter(Boolean)
    .map((part) => `<p>${inline(part.replaceAll(/\s*\n\s*/g, " "))}</p>`)
    .join("\n");
}

const nameOf = (ref) => ref.split("/").pop();
const schemaLink = (ref) => `<a href="#schema-${nameOf(ref)}">${nameOf(ref)}</a>`;

/** Follows `$ref` within the document; what stands beside it (a description) wins. */
function resolved(document, value) {
  if (!value?.$ref) return value;
  const { $ref, ...beside } = value;
  const target = $ref.slice(2).split("/").reduce((node, key) => node?.[key], document);
  if (target === undefined) throw new Error(`openapi.yaml refers to ${$ref}, which it does not have.`);
  return { ...resolved(document, target), ...beside };
}

/** A schema in a few words, with links to those that have a name. */
export function typeOf(schema) {
  if (schema === undefined) return "";
  if (schema.$ref) return schemaLink(schema.$ref);
  if (schema.const !== undefined) return `<code>${escaped(schema.const)}</code>`;
  if (schema.enum) return schema.enum.map((value) => `<code>${escaped(value)}</code>`).join(" | ");
  for (const kind of ["oneOf", "anyOf"]) {
    const parts = (schema[kind] ?? []).map(typeOf).filter(Boolean);
    if (parts.length > 0 && !schema.properties) return parts.join(" | ");
  }
  if (schema.type === "array") {
    const { minItems: low, maxItems: high } = schema;
    const many = low !== undefined && low === high ? ` of ${low}` : "";
    return `array${many}: ${typeOf(schema.items)}`;
  }
  const types = [schema.type ?? (schema.properties ? "object" : "any")].flat().join(" | ");
  const limits = [
    schema.format,
    schema.minimum !== undefined && `&ge; ${schema.minimum}`,
    schema.exclusiveMinimum !== undefined && `&gt; ${schema.exclusiveMinimum}`,
    schema.maximum !== undefined && `&le; ${schema.maximum}`,
    schema.maxLength !== undefined && `at most ${schema.maxLength} characters`,
    schema.pattern && `<code>${escaped(schema.pattern)}</code>`,
    schema.default !== undefined && `default ${escaped(schema.default)}`,
  ].filter(Boolean);
  return limits.length > 0 ? `${types}, ${limits.join(", ")}` : types;
}

function table(head, rows) {
  if (rows.length === 0) return "";
  const cells = (row) => row.map((cell) => `<td>${cell ?? ""}</td>`).join("");
  return `<table><thead><tr>${head.map((name) => `<th scope="col">${name}</th>`).join("")}</tr></thead>
<tbody>${rows.map((row) => `<tr>${cells(row)}</tr>`).join("\n")}</tbody></table>`;
}

function properties(document, schema) {
  const required = new Set(schema.required ?? []);
  return table(
    ["field", "type", "meaning"],
    Object.entries(schema.properties ?? {}).map(([name, property]) => {
      const inner = property.properties ? properties(document, property) : "";
      return [
        `<code>${escaped(name)}</code>${required.has(name) ? "" : " <small>optional</small>"}`,
        typeOf(property),
        inline(property.description ?? "") + inner,
      ];
    }),
  );
}

const contents = (content) =>
  Object.entries(content ?? {}).map(([type, { schema, example, examples }]) => {
    const shown = [...(example === undefined ? [] : [example]), ...Object.values(examples ?? {}).map(({ value }) => value)];
    const text = shown.map((value) => `<pre><code>${escaped(JSON.stringify(value))}</code></pre>`).join("");
    return [`<code>${type}</code>`, typeOf(schema), inline(schema?.description ?? "") + text];
  });

function operation(document, path, method, item, op) {
  const parameters = [...(item.parameters ?? []), ...(op.parameters ?? [])].map((one) => resolved(document, one));
  const body = resolved(document, op.requestBody);
  const answers = Object.entries(op.responses).map(([status, response]) => {
    const { description, content, headers } = resolved(document, response);
    const types = contents(content).map(([type, schema]) => `${type} ${schema}`).join("<br>");
    const fields = Object.keys(headers ?? {}).map((name) => `<code>${name}</code>`).join(", ");
    return [`<b>${status}</b>`, inline(description), [types, fields && `with ${fields}`].filter(Boolean).join("<br>")];
  });
  const scope = op["x-scope"] ?? "";
  return `<section class="operation" id="${op.operationId}">
<h3><span class="method ${method}">${method.toUpperCase()}</span> <code>${escaped(path)}</code></h3>
<p class="summary">${inline(op.summary ?? "")}${scope && ` <small>scope ${escaped(scope)}</small>`}</p>
${prose(op.description)}
${parameters.length > 0 ? "<h4>Parameters</h4>" : ""}
${table(["name", "in", "type", "meaning"], parameters.map((p) => [`<code>${escaped(p.name)}</code>${p.required ? "" : " <small>optional</small>"}`, p.in, typeOf(p.schema), inline(p.description ?? "")]))}
${body ? `<h4>Body</h4>${table(["content type", "schema", ""], contents(body.content))}` : ""}
<h4>Answers</h4>
${table(["status", "meaning", "content"], answers)}
</section>`;
}

/** The whole page; `stylesheet` is its address. */
export function renderApi(document, stylesheet) {
  const operations = Object.entries(document.paths).flatMap(([path, item]) =>
    METHODS.filter((method) => item[method]).map((method) => ({ path, method, item, op: item[method] })),
  );
  const byTag = document.tags.map(({ name }) => [name, operations.filter(({ op }) => op.tags?.[0] === name)]);
  const contentsList = byTag
    .map(
      ([tag, list]) =>
        `<li><a href="#tag-${tag.replaceAll(" ", "-")}">${tag}</a><ul>${list.map(({ op }) => `<li><a href="#${op.operationId}">${op.operationId}</a></li>`).join("")}</ul></li>`,
    )
    .join("");
  const sections = byTag.map(
    ([tag, list]) =>
      `<h2 id="tag-${tag.replaceAll(" ", "-")}">${tag}</h2>\n${list.map(({ path, method, item, op }) => operation(document, path, method, item, op)).join("\n")}`,
  );
  const schemas = Object.entries(document.components.schemas).map(
    ([name, schema]) =>
      `<section class="schema" id="schema-${name}"><h3>${name}</h3>${prose(schema.description)}${schema.properties ? "" : `<p>${typeOf(schema)}</p>`}${properties(document, schema)}</section>`,
  );
  return `<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>CELLmap API</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="${stylesheet}">
</head>
<body>
<nav aria-label="Operations"><p><a href="../">CELLmap</a></p><ul>${contentsList}<li><a href="#schemas">schemas</a></li></ul></nav>
<main>
<h1>${escaped(document.info.title)} API, version ${escaped(document.info.version)}</h1>
<p>${inline(document.info.summary ?? "")} The same for programs: <a href="../openapi.yaml">openapi.yaml</a>.</p>
${prose(document.info.description)}
${sections.join("\n")}
<h2 id="schemas">schemas</h2>
${schemas.join("\n")}
</main>
</body>
</html>
`;
}
