// What is the same of many is said once.

import assert from "node:assert/strict";
import { test } from "node:test";
import { grouped } from "../src/panels/alarm_groups.ts";

const alarm = (key: string, text: string, isFailed = false, since_us: number | null = 5) => ({
  key,
  isFailed,
  text,
  remedy: "look at it",
  since_us,
});

test("alarms of one kind on many boxes are one line, since the first of them", () => {
  const [clocks, camera, ...rest] = grouped([
    alarm("clock/ne", "the clock of ne is off by 12.5 ms", false, 30),
    alarm("camera/ne_a", "camera ne_a is black", true),
    alarm("clock/nw", "the clock of nw is off by 7 ms", false, 20),
    alarm("clock/se", "the clock of se is off by 900 ms", false, null),
  ]);
  assert.deepEqual(rest, []);
  assert.equal(clocks?.text, "3 clocks: ne, nw, se. The clock of ne is off by 12.5 ms");
  assert.equal(clocks?.members.length, 3);
  assert.equal(clocks?.since_us, 20);
  assert.equal(camera?.key, "camera/ne_a");
  assert.deepEqual(camera?.members, []);
});

test("what of it is behind the name is no part of the name", () => {
  const free = ["ne", "nw"].map((name) => alarm(`clock/${name}/free`, `nothing keeps the clock of edge ${name} right`));
  const [clocks, ...rest] = grouped(free);
  assert.deepEqual(rest, []);
  assert.equal(clocks?.text, "2 clocks: ne, nw. Nothing keeps the clock of edge ne right");
});

test("what is not the same stays apart: another severity, another text, no name", () => {
  const apart = [
    alarm("node/a", "edge a is silent", true),
    alarm("node/b", "edge b is silent", false),
    alarm("node/c", "edge c runs another release", true),
    alarm("poses", "no poses for 3 s", true),
    alarm("here/away", "nothing comes", true),
  ];
  assert.equal(grouped(apart).length, apart.length);
});

test("what one node says of several cameras is said of each, whatever it is", () => {
  const notice = (n: number): ReturnType<typeof alarm> => alarm(`node/fusion/notice/${n}`, `camera ${n} was moved by ${n}0 mm`);
  assert.deepEqual(grouped([notice(3), notice(4)]).map(({ text }) => text), ["camera 3 was moved by 30 mm", "camera 4 was moved by 40 mm"]);
});

test("many names are counted, not listed", () => {
  const many = Array.from({ length: 20 }, (_, i) => alarm(`link/v${i}`, `link v${i} is over its budget`));
  assert.match(grouped(many)[0]?.text ?? "", /^20 links: v0, v1, .*, v7 and 12 more\. Link v0 is over/);
});

test("a remedy that names its own is said for all of a group, or left to each", () => {
  const of = (name: string, remedy: string) => ({ ...alarm(`node/${name}`, `edge ${name} has not been heard`), remedy });
  const remedyOf = (...remedies: string[]): string => grouped(remedies.map((remedy, i) => of(`v${i}`, remedy)))[0]?.remedy ?? "";
  assert.equal(remedyOf("look at the switch", "look at the switch"), "look at the switch");
  assert.equal(remedyOf("look at v0", "look at v1"), "look at NAME (for each, by its name)");
  assert.match(remedyOf("look at v0", "call v1"), /open them/);
});
