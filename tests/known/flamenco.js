// Flamenco's side of a job type, by its documentation: what the manager gives to scripts, and keeps
// of the job. `node flamenco.js SCRIPT < {"settings": ...}` prints the job type and its tasks.
"use strict";
const fs = require("fs");
const vm = require("vm");

class Task {
    constructor(name, type) {
        if (typeof name !== "string" || !["blender", "ffmpeg", "file-management", "misc"].includes(type)) {
            throw new Error("no task: " + name + ", " + type);
        }
        this.name = name;
        this.type = type;
        this.commands = [];
        this.dependencies = [];
    }
    addCommand(command) { this.commands.push(command); }
    addDependency(task) { this.dependencies.push(task.name); }
}

// '1-5, 8' in chunks of so many frames, each as text: '1-3', '4,5,8'
function frameChunker(text, size) {
    const frames = [];
    for (const part of text.split(",")) {
        const found = /^\s*(\d+)(?:-(\d+))?\s*$/.exec(part);
        if (!found) throw new Error("no frames: " + part);
        for (let n = +found[1]; n <= +(found[2] || found[1]); n++) frames.push(n);
    }
    const chunks = [];
    for (let k = 0; k < frames.length; k += size) {
        const some = frames.slice(k, k + size);
        const isRange = some.every((n, i) => n === some[0] + i);
        chunks.push(isRange && some.length > 1 ? some[0] + "-" + some[some.length - 1] : some.join(","));
    }
    return chunks;
}

const given = JSON.parse(fs.readFileSync(0, "utf8"));
const tasks = [];
const world = vm.createContext({
    author: {
        Task: (name, type) => new Task(name, type),
        Command: (name, parameters) => ({ name, parameters }),
    },
    path: require("path").posix,
    frameChunker,
    print: () => {},
    formatTimestampLocal: () => "2026-01-01_000000",
});
vm.runInContext(fs.readFileSync(process.argv[2], "utf8") + "\nthis.JOB_TYPE = JOB_TYPE;", world);

let error = null;
try {
    world.compileJob({
        name: "a job",
        settings: given.settings,
        created: new Date(0),
        addTask: (task) => tasks.push(task),
    });
} catch (thrown) {
    error = String(thrown);
}
process.stdout.write(JSON.stringify({ type: world.JOB_TYPE, tasks, error }));
