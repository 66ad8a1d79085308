"""What lies on disk: scenes, records, shards, trials. Every file that is read is checked here.

`scene_folder` and `photo_files` stand at the border to users' files, `fields` and `strict_json` read JSON
for every part, `whole_or_nothing` writes. Simulation and training meet here and nowhere else: neither
imports the other.
"""
