document.querySelector(".ledger-filters").hidden = false;
addEventListener("DOMContentLoaded", () => {
  const form = document.querySelector(".ledger-filters");
  const rows = [...document.querySelectorAll("table.ledger tbody tr")];
  const value = name => form.querySelector(`[data-filter=${name}]`).value;
  const show = () => {
    const [verdict, flight, experiment] = ["verdict", "flight", "experiment"].map(value);
    const words = value("words").toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const row of rows) {
      const all = row.dataset.verdicts.split("|");
      const given = flight === "" ? all : [all[+flight]];
      const text = row.textContent.toLowerCase();
      row.hidden = (verdict && !given.includes(verdict)) ||
        (experiment && row.dataset.experiment !== experiment) ||
        !words.every(word => text.includes(word));
      count += !row.hidden;
    }
    form.querySelector("output").textContent = `${count} of ${rows.length} claims`;
  };
  form.addEventListener("input", show);
  form.addEventListener("submit", event => event.preventDefault());
});
