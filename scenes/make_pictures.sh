#!/bin/sh
# Renders docs/images/, the pictures of README.md, and removes the rest of their noise: twenty minutes on two cores. Names
# after the command choose some of them.
set -eu
cd "$(dirname -- "$0")/.."

picture() { # picture SCENE SIZE SAMPLES
    case " $chosen " in
    "  " | *" $1 "*) ./lajolla render "scenes/$1.xml" --size "$2" --spp "$3" --denoise -o "docs/images/$1.jpg" ;;
    esac
}

chosen="$*"
picture interior 720x450 1024
picture cornell-box 512x512 512
picture mis 660x440 512
picture materials 800x366 512
picture smoke 448x560 256
