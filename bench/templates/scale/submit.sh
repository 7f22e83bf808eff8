#!/bin/bash
# Submits the unfinished shards of {{plan}} to Slurm, and then the merge. Run it again if something was lost: shards whose
# units all have a result are not submitted.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
logs={{plan}}/logs/slurm
mkdir -p "$logs"
# sbatch puts values in for % and a letter.
logs=${logs//%/%%}
# An array has indices below MaxArraySize: more shards are several arrays, each counting from an offset.
size=$(scontrol show config | sed -n 's/^MaxArraySize *= *\([0-9]*\).*/\1/p')
shards=$({{binary}} status {{plan}} --unfinished-shards {{shards}} --max-index $((${size:-1001} - 1)) {{retry}})
after=
if [ -n "$shards" ]; then
    for stage in {{stages}}; do
        jobs=
        while read -r offset list; do
            job=$(sbatch --parsable ${after:+"--dependency=afterany:$after"} --array="$list" \
                --export=ALL,SHARD_OFFSET="$offset" --output="$logs/%x-%A_%a.out" "$here/$stage.sbatch")
            jobs=${jobs:+$jobs:}${job%%;*}
        done <<<"$shards"
        echo "$stage: $jobs"
        after=$jobs
    done
fi
merge=$(sbatch --parsable ${after:+"--dependency=afterany:$after"} --output="$logs/%x-%j.out" "$here/merge.sbatch")
echo "merge: ${merge%%;*}"
