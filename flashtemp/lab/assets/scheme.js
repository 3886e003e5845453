// Light or dark: the user's choice in this browser, or else as the system has it.
(() => {
    const key = "flashtemp-dark", chosen = localStorage.getItem(key);
    window.switchScheme = () => {
        Quasar.Dark.toggle();
        localStorage.setItem(key, Quasar.Dark.isActive ? "1" : "0");
    };
    const wait = setInterval(() => {
        if (!document.getElementById("content")) return;
        clearInterval(wait);
        if (chosen !== null) Quasar.Dark.set(chosen === "1");
    }, 5);
})();
