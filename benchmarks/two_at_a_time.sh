# For scripts to source: commands in the background, two at a time. `finish` waits for all and fails if one did:
# each is asked by its number, since `wait -n` misses those that ended before it.
pids=()
two_at_a_time() {
  while [ "$(jobs -pr | wc -l)" -ge 2 ]; do sleep 1; done
  "$@" &
  pids+=("$!")
}
finish() {
  for pid in "${pids[@]}"; do wait "$pid"; done
  pids=()
}
