// Times are sent in UTC and shown in the reader's own zone.

const format = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });
const hour = new Intl.DateTimeFormat(undefined, { timeStyle: "medium" });

export function localise(root = document) {
  for (const time of root.querySelectorAll("time[data-local]")) {
    time.title = `${time.dateTime} (UTC)`;
    time.textContent = format.format(new Date(time.dateTime));
  }
}

export function timeNow() {
  return hour.format(new Date());
}
