#!/usr/bin/env bash
# Every route of a live cellmapd with a right and a wrong input, by curl; checks status and problem code, and that
# nothing was lost. Usage: curl_routes.sh CELLMAP CELLMAPD
set -euo pipefail
cellmap=$1 cellmapd=$2
work=$(mktemp -d)
"$cellmap" simulate --route town --scans 30 --odometry truth --out "$work/drive" --json >/dev/null
"$cellmapd" --store "$work/map.db" --listen 127.0.0.1:0 --data-root "$work" >"$work/out" 2>"$work/log" &
pid=$!
trap 'kill $pid 2>/dev/null; wait $pid 2>/dev/null; rm -rf "$work"' EXIT
for _ in $(seq 100); do grep -q http:// "$work/out" && break; sleep 0.1; done
url=$(grep -o 'http://[^ ]*' "$work/out")
failures=0 checks=0

# expect STATUS CODE|- METHOD PATH [curl arguments...]: the answer's status and, for a problem, its code
expect() {
  local status=$1 code=$2 method=$3 path=$4; shift 4
  local method_flag=(-X "$method"); [[ $method == HEAD ]] && method_flag=(-I)
  local got; got=$(curl -sS -m 60 -o "$work/body" -w '%{http_code}' "${method_flag[@]}" "$@" "$url$path")
  local got_code="-"
  [[ $status -ge 400 ]] && got_code=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["code"])' "$work/body" 2>/dev/null || echo "no problem document")
  checks=$((checks + 1))
  local verdict=ok
  if [[ $got != "$status" || ( $code != - && $got_code != "$code" ) ]]; then
    verdict="WRONG: $got $got_code"; failures=$((failures + 1)); head -c 300 "$work/body"; echo
  fi
  printf '%-6s %-58s %s %-20s %s\n' "$method" "$path" "$status" "$code" "$verdict"
}
json=(-H 'Content-Type: application/json')
scan=(-H 'Content-Type: application/octet-stream')
cell=(-H 'Content-Type: application/vnd.cellmap.cell')

expect 200 - GET /; expect 200 - GET /healthz; expect 200 - GET /readyz; expect 200 - GET /metrics; expect 200 - GET /openapi.yaml
expect 404 not-found GET /nowhere
expect 405 - DELETE /healthz

expect 201 - POST /v1/maps "${json[@]}" -d '{"name":"town"}'
expect 409 already-exists POST /v1/maps "${json[@]}" -d '{"name":"town"}'
expect 400 invalid-argument POST /v1/maps "${json[@]}" -d '{"name":"../etc"}'
expect 400 invalid-argument POST /v1/maps "${json[@]}" -d '{"name":'
expect 415 unsupported POST /v1/maps -H 'Content-Type: text/plain' -d '{"name":"x"}'
expect 200 - GET /v1/maps; expect 200 - GET /v1/maps/town
expect 404 not-found GET /v1/maps/atlantis

expect 202 - POST /v1/maps/town/jobs "${json[@]}" -d "{\"kind\":\"ingest\",\"path\":\"$work/drive\"}"
expect 400 invalid-argument POST /v1/maps/town/jobs "${json[@]}" -d '{"kind":"ingest","path":"/etc"}'
expect 400 invalid-argument POST /v1/maps/town/jobs "${json[@]}" -d '{"kind":"dance"}'
for _ in $(seq 300); do
  curl -sS "$url/v1/jobs/1" | grep -q '"state": *"succeeded"' && break; sleep 0.2
done
expect 200 - GET /v1/jobs/1; expect 200 - GET /v1/maps/town/jobs; expect 200 - GET /v1/jobs/1/events
expect 404 not-found GET /v1/jobs/99
expect 409 conflict DELETE /v1/jobs/1
before=$(curl -sS "$url/v1/maps/town/pose-graph" -H 'Accept: application/json' | sha256sum)

expect 200 - GET '/v1/maps/town/cells?near=0,0,0&radius=50'
expect 400 invalid-argument GET '/v1/maps/town/cells?bbox=1,2,3'
expect 400 invalid-argument GET '/v1/maps/town/cells?near=0,nan,0&radius=50'
expect 400 invalid-argument GET '/v1/maps/town/cells?limit=0'
id=$(curl -sS "$url/v1/maps/town/cells" | python3 -c 'import json, sys; print(json.load(sys.stdin)["cells"][0]["id"])')
expect 200 - GET "/v1/maps/town/cells/$id"; cp "$work/body" "$work/cell"
expect 200 - HEAD "/v1/maps/town/cells/$id"
etag=$(curl -sSI "$url/v1/maps/town/cells/$id" | tr -d '\r' | awk 'tolower($1) == "etag:" {print $2}')
expect 304 - GET "/v1/maps/town/cells/$id" -H "If-None-Match: $etag"
expect 206 - GET "/v1/maps/town/cells/$id" -H 'Range: bytes=0-99'
expect 416 - GET "/v1/maps/town/cells/$id" -H 'Range: bytes=999999999-'
expect 200 - GET "/v1/maps/town/cells/$id" -H 'Accept: application/json'
expect 406 - GET "/v1/maps/town/cells/$id" -H 'Accept: image/png'
expect 404 not-found GET /v1/maps/town/cells/4000000
expect 400 invalid-argument GET /v1/maps/town/cells/banana
expect 200 - PUT "/v1/maps/town/cells/$id" "${cell[@]}" --data-binary "@$work/cell"
head -c 1000 "$work/cell" >"$work/truncated"
expect 422 corrupt-data PUT /v1/maps/town/cells/77 "${cell[@]}" --data-binary "@$work/truncated"
expect 400 invalid-argument PUT /v1/maps/town/cells/77 "${cell[@]}" -H 'CELLmap-Pose: 0 0 nan 0 0 0 1' --data-binary "@$work/cell"
expect 415 unsupported PUT /v1/maps/town/cells/77 -H 'Content-Type: image/png' --data-binary "@$work/cell"
head -c 40000000 /dev/zero >"$work/huge"
expect 413 too-large PUT /v1/maps/town/cells/77 "${cell[@]}" --data-binary "@$work/huge"
expect 413 too-large PUT /v1/maps/town/cells/77 "${cell[@]}" -H 'Transfer-Encoding: chunked' --data-binary "@$work/huge"
expect 200 - POST /v1/maps/town/cells:batch "${json[@]}" -d "{\"ids\":[$id]}"
expect 404 not-found POST /v1/maps/town/cells:batch "${json[@]}" -d '{"ids":[4000000]}'
expect 400 invalid-argument POST /v1/maps/town/cells:batch "${json[@]}" -d '{"ids":"all"}'

expect 200 - GET /v1/maps/town/pose-graph; expect 200 - GET '/v1/maps/town/pose-graph?revision=1' -H 'Accept: application/json'
expect 404 not-found GET '/v1/maps/town/pose-graph?revision=999999'
expect 400 invalid-argument GET '/v1/maps/town/pose-graph?revision=-1'
expect 200 - GET '/v1/maps/town/changes?since=0'; expect 400 invalid-argument GET '/v1/maps/town/changes?since=x'
expect 200 - GET '/v1/maps/town/changes?since=0&wait_s=1' -H 'Accept: application/vnd.cellmap.changes'
expect 400 invalid-argument GET '/v1/maps/town/changes?since=0&wait_s=999'
expect 400 invalid-argument GET /v1/maps/town/events -H 'Last-Event-ID: yesterday'; expect 404 not-found GET /v1/maps/none/events
stream=$(curl -sN --max-time 2 "$url/v1/maps/town/events" || true)  # ends by the time limit
checks=$((checks + 1)); grep -q '^event: revision' <<<"$stream" || { failures=$((failures + 1)); echo "WRONG: no event of a revision"; }
session=$(curl -sS "$url/v1/maps/town" | python3 -c 'import json, sys; print(json.load(sys.stdin)["sessions"][0])')
expect 200 - GET "/v1/maps/town/trajectory?session=$session&format=tum"
expect 400 invalid-argument GET "/v1/maps/town/trajectory?session=$session&format=gpx"

expect 400 invalid-argument GET "/v1/maps/town/diff?sessions=$session,$session"
expect 404 not-found GET "/v1/maps/town/diff?sessions=$session,atlantis"

expect 200 - POST /v1/maps/town/relocalise "${scan[@]}" --data-binary "@$work/drive/velodyne/000003.bin"
expect 200 - POST '/v1/maps/town/relocalise?prior=0,0,0,0,0,0,1&radius=20' "${scan[@]}" --data-binary "@$work/drive/velodyne/000003.bin"
head -c 1001 "$work/drive/velodyne/000003.bin" >"$work/malformed.bin"
expect 422 corrupt-data POST /v1/maps/town/relocalise "${scan[@]}" --data-binary "@$work/malformed.bin"
expect 400 invalid-argument POST '/v1/maps/town/relocalise?prior=0,0,nan,0,0,0,1' "${scan[@]}" --data-binary "@$work/drive/velodyne/000003.bin"
expect 413 too-large POST /v1/maps/town/relocalise "${scan[@]}" --data-binary "@$work/huge"
expect 415 unsupported POST /v1/maps/town/relocalise "${json[@]}" -d '{}'

expect 200 - GET /v1/maps/town/loops
expect 400 invalid-argument POST /v1/maps/town/loops "${json[@]}" -d "{\"from\":$id,\"to\":$id,\"pose\":[0,0,0,0,0,0,1]}"
expect 400 invalid-argument POST /v1/maps/town/loops "${json[@]}" -d "{\"from\":$id,\"to\":$((id + 1)),\"pose\":[null,0,0,0,0,0,1]}"
expect 404 not-found POST /v1/maps/town/loops "${json[@]}" -d '{"detect":4000000}'
expect 200 - POST /v1/maps/town/loops "${json[@]}" -d "{\"detect\":$id}"
expect 404 not-found GET /v1/maps/town/loops/4000000; expect 404 not-found DELETE /v1/maps/town/loops/4000000

expect 202 - POST /v1/maps/town/jobs "${json[@]}" -d '{"kind":"ingest","upload":true,"session":"second"}'
expect 422 corrupt-data PUT /v1/jobs/2/scans/0 -H 'Content-Type: application/vnd.cellmap.scan' -d 'nonsense'
expect 202 - DELETE /v1/jobs/2
scans=/v1/maps/town/sessions/third/scans
expect 200 - GET $scans
expect 422 corrupt-data POST $scans -H 'Content-Type: application/vnd.cellmap.scans' -d 'nonsense'
expect 422 corrupt-data POST $scans -H 'Content-Type: application/vnd.cellmap.scan' -H 'Transfer-Encoding: chunked' -d 'nonsense'
expect 413 too-large POST $scans -H 'Content-Type: application/vnd.cellmap.scans' -H 'Transfer-Encoding: chunked' --data-binary "@$work/huge"
expect 415 unsupported POST $scans "${json[@]}" -d '{}'
expect 404 not-found POST $scans:complete; expect 404 not-found GET /v1/maps/atlantis/sessions/third/scans
expect 400 invalid-argument PATCH /v1/maps/town/loops/1 "${json[@]}" -d '{"pinned":"yes"}'
expect 404 not-found PATCH /v1/maps/town/loops/4000000 "${json[@]}" -d '{"pinned":true}'
expect 404 not-found GET /v1/maps/town/georeference
expect 400 invalid-argument PUT /v1/maps/town/georeference "${json[@]}" -d '{"latitude_deg":1e999}'
archive=(-H 'Content-Type: application/vnd.cellmap.archive')
expect 206 - GET '/v1/maps/town/archive?encoding=compact&bound=0.05' -H 'Range: bytes=0-99'
expect 200 - GET /v1/maps/town/archive; cp "$work/body" "$work/town.cellmap"
expect 400 invalid-argument GET '/v1/maps/town/archive?encoding=zip'
expect 404 not-found GET /v1/maps/atlantis/archive
expect 201 - PUT /v1/maps/copy/archive "${archive[@]}" -T "$work/town.cellmap"
expect 409 already-exists PUT /v1/maps/copy/archive "${archive[@]}" -H 'Transfer-Encoding: chunked' -T "$work/town.cellmap"
expect 422 corrupt-data PUT /v1/maps/other/archive "${archive[@]}" -d 'no archive'
expect 204 - DELETE /v1/maps/copy
expect 400 invalid-argument POST /v1/maps/town/convert "${json[@]}" -d '{"encoding":"tiny"}'
expect 404 not-found POST /v1/maps/atlantis/convert "${json[@]}" -d '{"encoding":"packed"}'
expect 400 invalid-argument POST /v1/maps/town/merge "${json[@]}" -d '{"from":"town"}'
expect 404 not-found POST /v1/maps/town/merge "${json[@]}" -d '{"from":"atlantis"}'
expect 404 not-found POST /v1/maps/town/split "${json[@]}" -d '{"sessions":["nobody"],"into":"new"}'
expect 404 not-found DELETE /v1/maps/town/sessions/nobody
expect 200 - POST /v1/maps/town/relocalise "${cell[@]}" --data-binary "@$work/cell"
expect 422 corrupt-data POST /v1/maps/town/relocalise "${cell[@]}" --data-binary "@$work/truncated"

after=$(curl -sS "$url/v1/maps/town/pose-graph" -H 'Accept: application/json' | sha256sum)
[[ $before == "$after" ]] || { echo "the wrong inputs changed the map"; failures=$((failures + 1)); }
expect 204 - DELETE /v1/maps/town
expect 404 not-found DELETE /v1/maps/town
kill -0 $pid || { echo "cellmapd died"; failures=$((failures + 1)); }
echo "$checks answers checked, $failures wrong"
[[ $failures -eq 0 ]]
