// SPDX-License-Identifier: BSD-3-Clause
// Entry of the page: sets up its parts and passes messages between them.
import './style.css';

document.getElementById('app')!.textContent = 'rockfall';
