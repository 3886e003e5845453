// Of every chart: export as PNG, SVG or CSV, and restoring the zoom.
window.exportChart = (id, kind, name) => {
    const chart = getElement(id).chart, box = chart.getDom(), css = getComputedStyle(document.body);
    const save = (blob) => {
        const link = document.createElement("a");
        link.href = URL.createObjectURL(blob); link.download = name + "." + kind.toLowerCase(); link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    };
    if (kind === "CSV") {
        const option = chart.getOption(), quote = (s) => '"' + String(s).replaceAll('"', '""') + '"';
        const rows = [["series", option.xAxis[0].name, option.yAxis[0].name].map(quote).join(",")];
        for (const s of option.series.filter((one) => !one.silent)) for (const p of s.data ?? []) 
            rows.push([s.name ?? "", p[0], p[1]].map((v) => typeof v === "string" ? quote(v) : v).join(","));
        return save(new Blob([rows.join("\r\n") + "\r\n"], {type: "text/csv"}));
    }
    const plain = (text) => text.replace(/var\((--[\w-]+)\)/g, (_, key) => css.getPropertyValue(key).trim());
    const svg = box.querySelector("svg").cloneNode(true);
    svg.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [k, v] of Object.entries({width: "100%", height: "100%", fill: css.getPropertyValue("--surface").trim()}))
        ground.setAttribute(k, v);
    svg.prepend(ground);
    const blob = new Blob([plain(new XMLSerializer().serializeToString(svg))], {type: "image/svg+xml"});
    if (kind === "SVG") return save(blob);
    const image = new Image(), canvas = document.createElement("canvas"), zoom = 2;
    image.onload = () => {
        canvas.width = zoom * box.clientWidth; canvas.height = zoom * box.clientHeight;
        canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
        canvas.toBlob(save);
        URL.revokeObjectURL(image.src);
    };
    image.src = URL.createObjectURL(blob);
};
window.restoreZoom = (id) => {
    for (const dataZoomIndex of [0, 1])
        getElement(id).chart.dispatchAction({type: "dataZoom", dataZoomIndex, start: 0, end: 100});
};
