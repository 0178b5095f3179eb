// A worker in a frame: the search of a site that is opened as files, where browsers start no
// worker. The site's own script starts it by `new Worker(url)`, and its worker asks whether its
// parent has `IFrameWorker`; `importScripts` may be awaited there.
class IFrameWorker extends EventTarget {
  constructor(url) {
    super();
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    document.body.appendChild(this.frame);
    addEventListener("message", (event) => {
      if (event.source === this.frame.contentWindow) {
        const own = new MessageEvent("message", { data: event.data });
        this.dispatchEvent(own);
        if (this.onmessage) this.onmessage(own);
      }
    });
    const load = `(...urls) => urls.reduce((done, url) => done.then(() => new Promise((go, stop) => {
      const script = document.createElement("script");
      script.src = url; script.onload = go; script.onerror = stop;
      document.body.appendChild(script);
    })), Promise.resolve())`;
    this.ready = new Promise((go) => this.frame.addEventListener("load", go, { once: true }));
    this.frame.srcdoc = `<!doctype html><body><script>
      postMessage = (data) => parent.postMessage(data, "*");
      importScripts = ${load};
    <\/script><script src="${new URL(url, location.href)}"><\/script></body>`;
  }

  postMessage(data) {
    this.ready.then(() => {
      this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    });
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:") {
  window.IFrameWorker = IFrameWorker;
  window.Worker = IFrameWorker;
}
