var piece_start = -1e30;
        var is_more = true;
        while (is_more) {
            let next = NEXT;
            is_more = next < 1e30;
            let piece_end = next;
            var piece: Together;
            PIECES
            pixel = see(pixel, piece);
            if (is_more) {
                PASS
            }
            piece_start = piece_end;
        }