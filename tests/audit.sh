#!/bin/sh
# Licences, bans, sources and known faults of the dependencies of both languages; the argument is a Python environment.
# A finding ends with 1. A database that cannot be reached is no finding: it is said, in words that cannot be taken for "nothing found".
set -u
cd "$(dirname "$0")/.."
environment=${1:-.venv}
tools=${2:-.venv-audit}
failed=0
unreached=0

# Runs a check; where only its database is missing, says so.
check() {
    what=$1
    shift
    if said=$("$@" 2>&1); then
        # pip-audit ends well where it found nothing out.
        missed=$(echo "$said" | grep -c "could not be audited")
        if [ "$missed" -gt 3 ]; then
            echo "NOT CHECKED: $what: $missed packages were not found in its database, or it cannot be reached from here"
            unreached=1
        else
            echo "ok: $what"
        fi
    elif echo "$said" | grep -qiE "failed to fetch|couldn.t fetch|resolve host|timed out|terminated|connection ?error|service unavailable|max retries"; then
        echo "NOT CHECKED: $what: its database cannot be reached from here"
        unreached=1
    else
        echo "$said"
        echo "FOUND: $what"
        failed=1
    fi
}

check "licences, bans and sources of the crates (cargo-deny)" cargo deny check licenses bans sources
check "known faults of the crates (cargo-deny)" cargo deny check advisories
check "known faults of the crates (cargo-audit)" cargo audit
check "known faults of the Python packages (pip-audit)" timeout 120 "$tools/bin/pip-audit" --timeout 20 --progress-spinner off \
    --path "$("$environment/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"
if [ "$unreached" = 1 ]; then echo "Not everything was checked."; fi
exit "$failed"
