// SPDX-License-Identifier: BSD-3-Clause
// Forms made from the server's table of keys: each field has a row with unit, default, range, meaning, and error.
import { element, options, uniqueId } from './dom';
import type { Field, SettingValue, Value } from './protocol';
import { decimal, say, sayOr, unitText } from './texts';

export type Values = Readonly<Record<string, SettingValue>>;
type Control = HTMLInputElement | HTMLSelectElement;

function numeric({ kind }: Field): boolean {
  return kind === 'real' || kind === 'integer' || kind === 'count';
}

/** Label of a key: a translated text for common keys, the name for others. */
export function labelOf(field: Field): string {
  return sayOr(`app.key.${field.name}`, field.name);
}

/** Allowed values and meaning of a field. */
function describe(field: Field): string {
  const { min, max, unit } = field;
  const [low, high] = [min, max].map((limit) => limit !== null && decimal(limit));
  const words = field.choices && !field.list ? '' : field.allowed;
  const range = low && high ? `${low} – ${high}` : low ? `≥ ${low}` : high ? `≤ ${high}` : words;
  return [`${field.name}${unit ? ` [${unitText(unit)}]` : ''}`, field.meaning, range].filter(Boolean).join('\n');
}

function shown(value: SettingValue | null | undefined): string {
  if (value === null || value === undefined) return '';
  if (Array.isArray(value)) return value.map((one) => shown(one)).join('; ');
  return typeof value === 'number' ? decimal(value).replace(/[\u202f,](?=\d{3}\b)/g, '') : String(value);
}

/** Number from typed text, with a point or a comma; NaN if invalid. */
function parsed(text: string, integer: boolean): number {
  const value = Number(text.replace(/[\s\u202f']/g, '').replace(',', '.'));
  return integer && !Number.isInteger(value) ? NaN : value;
}

/** Value of the typed text: undefined if empty, null if invalid. */
export function read(field: Field, text: string): SettingValue | undefined | null {
  const trimmed = text.trim();
  if (!trimmed) return undefined;
  const one = (part: string): Value | null => {
    if (!numeric(field)) return part.trim();
    const value = parsed(part, field.kind !== 'real');
    return Number.isFinite(value) ? value : field.kind === 'count' ? part.trim() : null;
  };
  if (!field.list) return one(trimmed);
  const parts = trimmed
    .split(numeric(field) ? /\s*;\s*|,\s+|\s+/ : /\s*[;,]\s*/)
    .filter(Boolean)
    .map(one);
  return parts.some((part) => part === null) ? null : (parts as Value[]);
}

/** A field: label, control, unit, and error line. */
class Row {
  readonly root: HTMLElement;
  private readonly control: Control;
  private unreadable = ''; // error for invalid text
  private readonly message = element('p', { class: 'field-error', id: uniqueId('error'), attributes: { role: 'alert' } });

  constructor(
    private readonly field: Field,
    private readonly change: (value: SettingValue | undefined) => void,
  ) {
    this.control = this.makeControl();
    this.control.id = uniqueId('field');
    this.control.dataset['field'] = field.name;
    this.control.setAttribute('aria-description', describe(field));
    this.control.addEventListener('change', () => this.commit());
    const label = element('label', { attributes: { for: this.control.id } }, labelOf(field));
    const unit = element('span', { class: 'unit' }, unitText(field.unit));
    this.root = element('div', { class: `field ${field.kind}`, title: describe(field) }, label, this.control, unit, this.message);
    this.message.hidden = true;
    if (!field.choices || this.control.tagName !== 'INPUT') return;
    const words = options(field.choices.map((one) => [one, '']));
    const list = element('datalist', { id: uniqueId('words') }, ...words); // suggestions for a list
    this.control.setAttribute('list', list.id);
    this.root.append(list);
  }

  update(value: SettingValue | undefined, error: string | undefined, editable: boolean): void {
    const { control } = this;
    if (control instanceof HTMLInputElement && control.type === 'checkbox')
      control.checked = (value ?? this.field.default ?? false) === true;
    else if (control instanceof HTMLSelectElement) {
      const text = shown(value);
      if (text && ![...control.options].some((option) => option.value === text))
        control.append(...options([[text, text]]));
      control.value = text;
    } else if (control.dataset['committed'] !== shown(value) || (control !== document.activeElement && !this.unreadable)) {
      this.unreadable = '';
      control.value = shown(value);
      control.dataset['committed'] = control.value;
    }
    if (control instanceof HTMLInputElement && control.type !== 'checkbox')
      control.readOnly = !editable || this.field.read_only;
    else control.disabled = !editable || this.field.read_only;
    this.root.classList.toggle('given', value !== undefined);
    this.complain(error ?? this.unreadable);
  }

  private makeControl(): Control {
    const { field } = this;
    if (field.kind === 'logical') return element('input', { attributes: { type: 'checkbox' } });
    if (field.choices && !field.list) {
      const byDefault = field.default === null ? '–' : say('app.form.default', { value: shown(field.default) });
      return element('select', {}, ...options([['', byDefault], ...field.choices.map((one) => [one, one] as const)]));
    }
    const input = element('input', { attributes: { type: 'text', autocomplete: 'off', spellcheck: 'false' } });
    input.placeholder = shown(field.default);
    if (numeric(field)) {
      input.inputMode = 'decimal';
      input.addEventListener('keydown', (event) => this.step(event));
    }
    return input;
  }

  private complain(error: string): void {
    this.message.textContent = error;
    this.message.hidden = !error;
    this.control.setAttribute('aria-invalid', String(Boolean(error)));
    if (error) this.control.setAttribute('aria-errormessage', this.message.id);
    else this.control.removeAttribute('aria-errormessage');
  }

  private commit(): void {
    const { control } = this;
    if (control instanceof HTMLInputElement && control.type === 'checkbox') {
      this.change(control.checked);
      return;
    }
    const value = read(this.field, control.value);
    if (value === null) {
      this.unreadable = say(this.field.kind === 'integer' ? 'app.form.no_integer' : 'app.form.no_number');
      this.complain(this.unreadable);
      return;
    }
    this.unreadable = '';
    this.complain(''); // until the server replies
    control.dataset['committed'] = shown(value);
    this.change(value);
  }

  /** Arrow keys change a number by one step, with Shift by ten. */
  private step(event: KeyboardEvent): void {
    const direction = event.key === 'ArrowUp' ? 1 : event.key === 'ArrowDown' ? -1 : 0;
    if (!direction || this.field.list || this.field.read_only || (this.control as HTMLInputElement).readOnly) return;
    event.preventDefault();
    const text = this.control.value || shown(this.field.default);
    const now = parsed(text || '0', false);
    if (!Number.isFinite(now)) return;
    const size = this.field.kind === 'integer' ? 1 : 10 ** (now ? Math.floor(Math.log10(Math.abs(now)) + 1e-9) - 1 : -1);
    const next = now + direction * size * (event.shiftKey ? 10 : 1);
    const bounded = Math.max(this.field.min ?? -Infinity, Math.min(this.field.max ?? Infinity, next));
    this.control.value = shown(Number(bounded.toPrecision(12)));
    this.commit();
  }
}

/** A form with several fields. Its rows stay when values change, so that the focus is kept. */
export class Form {
  readonly root = element('div', { class: 'form' });
  private readonly rows = new Map<string, Row>();

  constructor(
    readonly fields: readonly Field[],
    change: (name: string, value: SettingValue | undefined) => void,
  ) {
    for (const field of fields) {
      const row = new Row(field, (value) => change(field.name, value));
      this.rows.set(field.name, row);
      this.root.append(row.root);
    }
  }

  update(values: Values, errors: ReadonlyMap<string, string>, editable: boolean): void {
    for (const [name, row] of this.rows) row.update(values[name], errors.get(name), editable);
  }

  /** Show only the fields that pass a test; returns their number. */
  filter(keep: (field: Field) => boolean): number {
    let number = 0;
    for (const field of this.fields) {
      const kept = keep(field);
      (this.rows.get(field.name) as Row).root.hidden = !kept;
      if (kept) number++;
    }
    return number;
  }
}
