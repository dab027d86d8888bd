# SPDX-License-Identifier: Apache-2.0
"""Router that connects the processes of runs on several machines or in containers.

Imported by nobody. It forwards messages and never decodes them.
"""
