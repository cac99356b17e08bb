import { mount } from "svelte";
import App from "./App.svelte";
import "./app.css";
import { router } from "./lib/router.svelte.ts";
import { session } from "./lib/session.svelte.ts";

const target = document.getElementById("app");
if (!target) throw new Error("index.html has no #app");

router.start();
if (router.route.page !== "sign-in") void session.load();
mount(App, { target });
