// SPDX-License-Identifier: Apache-2.0
// Writes the depth alone.

void main() {}
