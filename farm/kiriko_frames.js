// Flamenco's job type for Kiriko: source images of an animation, in chunks of frames.
// Put this file into the folder "scripts" beside the Flamenco Manager, and start the manager anew.
// The workers' Blender needs nothing installed: the folder "Kiriko" has its zip and bootstrap.

const JOB_TYPE = {
    label: "Kiriko Frames",
    description: "Solve the source images of an animation, and check that all are there.",
    settings: [
        {
            key: "frames",
            type: "string",
            required: true,
            eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
            evalInfo: { showLinkButton: true, description: "Scene frame range" },
            description: "Frames to solve. Examples: '47', '1-30', '3, 5-10, 47-327'",
        },
        {
            key: "chunk_size",
            type: "int32",
            default: 10,
            propargs: { min: 1 },
            description: "Frames that a worker solves from one start of Blender",
            visible: "submission",
        },
        {
            key: "kiriko",
            type: "string",
            subtype: "dir_path",
            required: true,
            description: "Folder with kiriko_bootstrap.py and Kiriko's zip, which all workers see",
            visible: "submission",
        },
        {
            key: "output",
            type: "string",
            subtype: "dir_path",
            required: true,
            description: "Folder for the source images, which all workers see",
        },
        {
            key: "rig",
            type: "string",
            required: false,
            default: "",
            description: "Name of the rig's collection; empty: the rig that the file shows",
            visible: "submission",
        },
        {
            key: "viewers",
            type: "string",
            required: false,
            default: "",
            description: "Names of viewers' cameras with commas between: tasks for each alone, with a folder of its name; empty: for all at once",
            visible: "submission",
        },
        {
            key: "format",
            type: "string",
            required: true,
            choices: ["PNG8", "PNG16", "TIFF16", "EXR_HALF", "EXR_FLOAT"],
            default: "PNG8",
            description: "File format of the source images",
            visible: "submission",
        },
        {
            key: "overwrite",
            type: "bool",
            default: false,
            description: "Solve frames again whose files are there already",
            visible: "submission",
        },
        {
            key: "blendfile",
            type: "string",
            required: true,
            description: "Path of the Blend file to solve",
            visible: "web",
        },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    for (const key of ["kiriko", "output"]) {
        if (!settings[key] || !settings[key].trim()) {
            throw "Kiriko Frames: the setting '" + key + "' is empty: choose a folder that all workers see.";
        }
    }
    if (!(settings.chunk_size >= 1)) {
        throw "Kiriko Frames: a task of no frames: set the chunk size to 1 or more.";
    }

    const viewers = viewersOf(settings);
    const chunks = frameChunker(settings.frames, settings.chunk_size);
    const rig = settings.rig ? ["--rig=" + settings.rig] : []; // a name may begin with a dash
    const overwrite = settings.overwrite ? ["--overwrite"] : [];
    const tasks = [];
    for (const viewer of viewers.length ? viewers : [null]) {
        for (const chunk of chunks) {
            const task = author.Task((viewer ? viewer.folder + "-" : "") + "solve-" + chunk, "blender");
            const alone = viewer ? ["--only-viewer=" + viewer.name] : [];
            const folder = viewer ? path.join(settings.output, viewer.folder) : settings.output;
            task.addCommand(kiriko(settings, ["solve", "--frames=" + chunk, "--log=" + chunk]
                .concat(rig, alone, overwrite), folder));
            job.addTask(task);
            tasks.push(task);
        }
    }

    const join = author.Task("join", "blender");
    const folders = viewers.length ? ["--folders"].concat(viewers.map((one) => one.folder)) : [];
    join.addCommand(kiriko(settings, ["join", "--frames=" + settings.frames].concat(folders),
        settings.output));
    for (const task of tasks) {
        join.addDependency(task);
    }
    job.addTask(join);
}

// The viewers that are asked for, each with a folder of another name.
function viewersOf(settings) {
    const names = (settings.viewers || "").split(",").map((name) => name.trim()).filter((name) => name);
    const taken = [];
    return names.map((name) => {
        const base = name.replace(/[\s.\/\\:*?"<>|-]+/g, "_");
        let folder = base;
        for (let n = 2; taken.includes(folder.toLowerCase()); n++) {
            folder = base + "_" + n;
        }
        taken.push(folder.toLowerCase());
        return { name: name, folder: folder };
    });
}

// Kiriko's command line, in a Blender with factory settings.
function kiriko(settings, verb, folder) {
    return author.Command("blender-render", {
        exe: "{blender}",
        exeArgs: "{blenderArgs}",
        argsBefore: ["--factory-startup"],
        blendfile: settings.blendfile,
        args: [
            "--python-exit-code", "1",
            "--python", path.join(settings.kiriko, "kiriko_bootstrap.py"),
            "--",
        ].concat(verb, ["--format", settings.format, "--out", folder]),
    });
}
