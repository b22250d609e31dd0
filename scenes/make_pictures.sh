#!/bin/sh
# Renders docs/images/, the pictures of README.md: an hour on two cores. Names after the command choose some of them.
set -eu
cd "$(dirname -- "$0")/.."

picture() { # picture SCENE SIZE SAMPLES [OPTION]
    case " $chosen " in
    "  " | *" $1 "*) ./lajolla render "scenes/$1.xml" --size "$2" --spp "$3" ${4:+"$4"} -o "docs/images/$1.jpg" ;;
    esac
}

chosen="$*"
picture interior 720x450 4096
picture cornell-box 512x512 512 --denoise
picture mis 660x440 512 --denoise
picture materials 800x366 512 --denoise
picture smoke 448x560 256 --denoise
