#!/bin/sh
# Renders docs/images/, the pictures of README.md: hours on two cores. Names after the command choose some of them.
set -eu
cd "$(dirname -- "$0")/.."

picture() { # picture SCENE SIZE SAMPLES
    case " $chosen " in
    "  " | *" $1 "*) ./lajolla render "scenes/$1.xml" --size "$2" --spp "$3" -o "docs/images/$1.jpg" ;;
    esac
}

chosen="$*"
picture interior 720x450 4096
picture cornell-box 512x512 2048
picture mis 660x440 2048
picture materials 800x366 2048
picture smoke 448x560 1024
