// Pages of another site in a real browser: none of the ways in which a page can cause a request changes the probe's settings.
// Both sites have names for which browsers send no Sec-Fetch-Site over plain HTTP, and the other site sends no referrer (no-referrer).

import { createServer } from "node:http";
import { check, text, until } from "./browser.mjs";

/** Ways in which a page causes a request for `url`; `post` marks those that send a form. */
const WAYS = {
  image: url => `<img src="${url}">`,
  background: url => `<div style="background: url('${url}'); width: 9px; height: 9px"></div>`,
  formGet: url => `<form action="${url.split("?")[0]}">${fields(url)}</form><script>document.forms[0].submit()</script>`,
  formPost: url => `<form method="post" action="${url.split("?")[0]}">${fields(url)}</form><script>document.forms[0].submit()</script>`,
  navigation: url => `<script>location = "${url}"</script>`,
  refresh: url => `<meta http-equiv="refresh" content="0; url=${url}">`,
  popup: url => `<script>window.open("${url}", "_self")</script>`,
  fetch: url => `<script>fetch("${url}", { mode: "no-cors", credentials: "include" })</script>`,
  fetchPost: url => `<script>fetch("${url.split("?")[0]}", { method: "POST", mode: "no-cors", credentials: "include",
    body: new URLSearchParams("${url.split("?")[1]}") })</script>`,
  beacon: url => `<script>navigator.sendBeacon("${url.split("?")[0]}", new URLSearchParams("${url.split("?")[1]}"))</script>`,
  frame: url => `<iframe src="${url}"></iframe>`,
  object: url => `<object data="${url}"></object>`,
  prefetch: url => `<link rel="prefetch" href="${url}">`,
  stylesheet: url => `<link rel="stylesheet" href="${url}">`,
  script: url => `<script src="${url}"></script>`,
  module: url => `<script type="module" src="${url}"></script>`,
  audio: url => `<audio src="${url}" preload="auto"></audio>`,
  video: url => `<video src="${url}" preload="auto"></video>`,
};

function fields(url) {
  const pairs = [...new URL(url).searchParams];
  return pairs.map(([name, value]) => `<input name="${name}" value="${value}">`).join("");
}

/** A site whose page is `site.body`. */
async function otherSite() {
  const site = { body: "" };
  const server = createServer((request, response) => {
    response.writeHead(200, { "Content-Type": "text/html", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store" });
    response.end(request.url === "/" ? `<!DOCTYPE html>${site.body}` : "");
  });
  await new Promise(done => server.listen(0, "127.0.0.1", done));
  return Object.assign(site, { server, url: `http://evil.test:${server.address().port}/` });
}

/** Returns the number of answers to requests for /change. */
async function requests(url) {
  const metrics = await (await fetch(`${url}metrics`)).text();
  const lines = metrics.split("\n").filter(line => line.startsWith('hemilux_requests_total{path="/change"'));
  return lines.reduce((sum, line) => sum + Number(line.split(" ")[1]), 0);
}

const lights = async url => (await (await fetch(`${url}v1/config`)).json()).values.lights;

async function attack(browser, url, enter, options = {}) {
  const probe = url.replace("127.0.0.1", "probe.lan"), site = await otherSite(), context = await browser.newContext(options);
  await enter(context, probe);
  const before = await lights(url);
  for (const [way, page] of Object.entries(WAYS)) {
    const count = await requests(url), tab = await context.newPage();
    site.body = page(`${probe}change?samples=${before + 1}&gui=on`);
    await tab.goto(site.url, { waitUntil: "commit" }).catch(() => {});
    await until(`${way}: the request has come`, async () => await requests(url) > count);
    check(await lights(url) === before, `${way}: the settings have changed`);
    await tab.close();
  }
  site.server.close();
  // A request that a person typed is answered with a form; submitting the form changes the settings.
  const tab = await context.newPage();
  await tab.goto(`${probe}change?samples=${before + 2}`);
  check((await text(tab, "body")).includes("Nothing was changed"), await text(tab, "body"));
  check(await lights(url) === before, "an address that was typed is to be confirmed");
  await tab.click("button");
  await until("the change is confirmed", async () => await lights(url) === before + 2);
  await context.close();
}

export const foreignOpen = (browser, url) => attack(browser, url, async () => {});

/** The browser has stored the token as a Basic password, and sends it with each request. */
export const foreignBasic = (browser, url, token) => attack(browser, url, async (context, probe) => {
  const tab = await context.newPage();
  await tab.goto(`${probe}info`);
  // The browser loads a picture of the root path, after which it sends the password with requests for all paths.
  const load = path => new Promise(done => Object.assign(new Image(), { onload: () => done(true), onerror: () => done(false), src: path }));
  check(await tab.evaluate(load, "/image"), "the picture is shown with the password");
  await tab.close();
}, { httpCredentials: { username: "x", password: token } });

/** The browser has logged in, and has the cookie. */
export const foreignCookie = (browser, url, token) => attack(browser, url, async (context, probe) => {
  const tab = await context.newPage();
  await tab.goto(`${probe}login`);
  await tab.fill("input[name=token]", token);
  await tab.click("button");
  await tab.waitForURL(probe);
  await tab.close();
});
