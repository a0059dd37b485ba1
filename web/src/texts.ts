// SPDX-License-Identifier: BSD-3-Clause
// Words and numbers in the server's language. The page has no texts of its own.
import type { Estimate } from './protocol';


let texts: Readonly<Record<string, string>> = {};
let language = 'en';

export function setTexts(catalogue: Readonly<Record<string, string>>, chosen: string): void {
  texts = catalogue;
  language = chosen;
  formats.clear();
}

/** Text of a key with its placeholders filled; numbers are formatted for the language. */
export function say(key: string, values: object = {}): string {
  return sayOr(key, key, values);
}

/** Text of a key, or `otherwise` if the catalogue lacks the key. */
export function sayOr(key: string, otherwise: string, values: object = {}): string {
  const given = values as Readonly<Record<string, unknown>>;
  return (texts[key] ?? otherwise).replace(/\{(\w+)\}/g, (whole, name: string) => {
    const value = given[name];
    return typeof value === 'number' ? decimal(value) : value === undefined ? whole : String(value);
  });
}

const formats = new Map<number, Intl.NumberFormat>();

/** Format a number with this many decimals; by default as many as needed (at most 6). */
export function decimal(value: number, decimals = -1): string {
  let format = formats.get(decimals);
  if (!format) {
    const digits =
      decimals < 0
        ? { maximumFractionDigits: 6 }
        : { minimumFractionDigits: decimals, maximumFractionDigits: decimals };
    format = new Intl.NumberFormat(language, { useGrouping: true, ...digits });
    formats.set(decimals, format);
  }
  if (language === 'en') return format.format(value);
  // Thousands separator as in the report (ISO 80000-1): a narrow space, except in English.
  const parts = format.formatToParts(value).map((part) => (part.type === 'group' ? '\u202f' : part.value));
  return parts.join('').replace(/^-/, '−');
}

/** Decimals that an interval supports, down to the first digit of its half-width, or the second if the first is 1; negative
 * for tens. */
export function supportedDecimals([value, low, high]: Estimate, otherwise: number): number {
  if (value === null || low === null || high === null || !(high > low)) return otherwise;
  const half = (high - low) / 2;
  const power = Math.floor(Math.log10(half));
  return Math.min(otherwise + 1, half < 2 * 10 ** power ? 1 - power : -power);
}

/** Number rounded to these decimals; negative: to tens or hundreds. */
export function rounded(value: number, decimals: number): string {
  if (decimals >= 0) return decimal(value, Math.min(6, decimals));
  const step = 10 ** -decimals;
  return decimal(Math.round(value / step) * step, 0);
}

/** Duration in words, from seconds. */
export function duration(seconds: number): string {
  if (seconds < 10) return `${decimal(seconds, 1)} s`;
  if (seconds < 90) return `${decimal(seconds, 0)} s`;
  if (seconds < 5400) return `${decimal(seconds / 60, 0)} min`;
  return `${decimal(seconds / 3600, 1)} h`;
}

/** Unit in its printed form. */
export function unitText(unit: string): string {
  const word = texts[`app.unit.${unit}`];
  if (word !== undefined) return word;
  return unit === 'degree' ? '°' : unit.replace(/\bm([23])\b/g, (_, power: string) => (power === '2' ? 'm²' : 'm³'));
}
